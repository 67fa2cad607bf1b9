"""ReplayBuffer buffer: observations in a ring of preallocated arrays (paper, appendix: 1M frames).

One row per observation. The transition of row r goes to the next row of the ring, unless row r is
the last of its trajectory. Five objects take about 0.42 KB per row; memory is touched as rows fill.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.learning.errors import LearningError
from pa_ros.learning.relabeling.all_goals import Marks
from pa_ros.learning.replay_buffer.ledger import Ledger
from pa_ros.world import Trajectory
from pa_ros.world.world import World

# Of absolute values. Metres, rad/s and one-hots of any arena are far below, and an update of such
# numbers is finite.
LARGEST = {"objects": 1e4, "arm": 1e4, "actions": 1.0, "rewards": 1e6}
Int64 = NDArray[np.int64]
NOTHING = Marks(np.zeros((), np.uint64), 0)


@dataclass(frozen=True, slots=True)
class InsertReport:
    """What became of one trajectory."""

    accepted: bool  # False: it was there already
    transitions: int  # now sampleable because of it
    missing: int  # trajectories skipped and not arrived since, over all agents
    duplicates: int  # so far


class ReplayBuffer:
    """Ring of the latest `capacity` observations of scenes with `n_objects` objects.

    The hand is stored first, whatever its index outside. The number of objects is fixed by the
    first trajectory if it is not given.
    """

    def __init__(
        self,
        capacity: int,
        world: World,
        n_objects: int | None = None,
        goals: int = 0,
    ) -> None:
        """`goals`: relabeling programs whose rewards are kept with every row."""
        self.capacity, self._goals = capacity, goals
        self.world = world
        self.ledger = Ledger()
        self.rows = 0  # filled
        self.head = 0  # next row to be written
        self.arrays: dict[str, NDArray[Any]] = {}
        if n_objects is not None:
            self._allocate(n_objects)

    @property
    def transitions(self) -> int:
        """Number of sampleable transitions."""
        return int(np.count_nonzero(~self.arrays["last"][: self.rows])) if self.arrays else 0

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays at full capacity."""
        return sum(array.nbytes for array in self.arrays.values())

    def check(self, trajectory: Trajectory) -> None:
        """Raise a LearningError unless the trajectory can be inserted."""
        if trajectory.world_digest != self.world.digest:
            raise LearningError(
                f"trajectory: expected world {self.world.digest}, "
                f"got {trajectory.world_digest} from {trajectory.agent_id!r}",
                code="learning.world",
            )
        self.ledger.check(trajectory)
        self._check_sizes(trajectory)
        for name, bound in LARGEST.items():
            values = getattr(trajectory, name)
            if not np.isfinite(values).all():
                raise LearningError(
                    f"trajectory: {name}: expected finite numbers", code="learning.non_finite"
                )
            if (largest := np.abs(values).max()) > bound:
                raise LearningError(
                    f"trajectory: {name}: expected numbers in [-{bound:g}, {bound:g}], "
                    f"got ±{largest:g} from {trajectory.agent_id!r}",
                    code="learning.out_of_bounds",
                )

    def insert(
        self,
        trajectory: Trajectory,
        program: int,
        marks: Marks | None = None,
    ) -> InsertReport:
        """Insert once: a second time is counted and changes nothing else.

        `program` is the row of the trajectory's program in the learner's table; `marks` are
        the relabeler's of its T + 1 rows.
        Raises a LearningError, leaving the replay as it was, if `check` does.
        """
        self.check(trajectory)
        accepted = self.ledger.is_new(trajectory.key)
        if accepted:
            self.ledger.record(trajectory.key, trajectory.held_from)
            self._write(trajectory, program, marks or NOTHING)
        else:
            self.ledger.duplicates += 1
        transitions = len(trajectory) if accepted else 0
        return InsertReport(accepted, transitions, self.ledger.missing, self.ledger.duplicates)

    def sample(self, rng: np.random.Generator, size: int) -> Int64:
        """Draw rows [size] of transitions, uniformly and with replacement."""
        if self.rows == 0:
            raise LearningError(
                "replay: expected transitions, got an empty buffer", code="learning.empty_replay"
            )
        index = rng.integers(self.rows, size=size)
        last = self.arrays["last"]
        while (again := np.flatnonzero(last[index])).size:
            index[again] = rng.integers(self.rows, size=again.size)
        return index

    def following(self, index: Int64) -> Int64:
        """Row that the transition of each row goes to."""
        return (index + 1) % self.capacity

    def filled(self) -> dict[str, NDArray[Any]]:
        """Views of the rows in use; with `to_metadata` all there is to save."""
        return {name: array[: self.rows] for name, array in self.arrays.items()}

    def to_metadata(self) -> dict[str, Any]:
        """Plain values for JSON."""
        ledger = self.ledger.to_metadata()
        return {"rows": self.rows, "head": self.head, "ledger": ledger}

    def restore(self, arrays: dict[str, NDArray[Any]], values: dict[str, Any]) -> None:
        """The inverse of `filled` and `to_metadata`; LearningError if they do not fit."""
        rows, head = int(values["rows"]), int(values["head"])
        if not (0 <= rows <= self.capacity and 0 <= head < self.capacity):
            raise LearningError(
                f"replay: expected {self.capacity} rows, got {rows} at {head}", code="learning.size"
            )
        if arrays:
            self._allocate(arrays["objects"].shape[1])
            for name, array in self.arrays.items():
                if arrays[name].shape != (rows, *array.shape[1:]):
                    raise LearningError(
                        f"replay: {name}: expected {rows} rows, got {arrays[name].shape}",
                        code="learning.size",
                    )
                array[:rows] = arrays[name]
        self.rows, self.head = rows, head
        self.ledger = Ledger.from_metadata(values["ledger"])

    def _allocate(self, n_objects: int) -> None:
        shapes: dict[str, tuple[tuple[int, ...], Any]] = {
            "objects": ((n_objects, self.world.object_features), np.float32),
            "arm": ((self.world.arm_features,), np.float32),
            "action": ((self.world.actions,), np.float32),
            "reward": ((), np.float32),
            "program": ((), np.int32),
            "last": ((), np.bool_),  # of its trajectory: no transition starts here
            "terminal": ((), np.bool_),  # its transition ends the task, not just the time
            "satisfied": ((), np.uint64),  # bit j: relabeling program j, at this row
            "present": ((), np.uint64),  # bit j: program j names an object of the scene
        }
        if self._goals:  # of relabeling program j, at this row
            shapes["goal_reward"] = (self._goals,), np.float32
        try:
            arrays = {k: np.zeros((self.capacity, *s), dtype) for k, (s, dtype) in shapes.items()}
        except MemoryError as error:
            raise LearningError(
                f"replay: expected memory for {self.capacity} frames of {n_objects} objects "
                f"(capacity_frames), got none: {error}",
                code="learning.size",
            ) from error
        self.arrays = arrays

    def _check_sizes(self, trajectory: Trajectory) -> None:
        steps, found = len(trajectory), trajectory.objects.shape
        if len(found) != 3:
            raise LearningError(
                f"trajectory: objects: expected three dimensions, got {found}", code="learning.size"
            )
        n_objects = self.arrays["objects"].shape[1] if self.arrays else found[1]
        expected = {
            "objects": (steps + 1, n_objects, self.world.object_features),
            "arm": (steps + 1, self.world.arm_features),
            "actions": (steps, self.world.actions),
            "rewards": (steps,),
        }
        for name, shape in expected.items():
            if getattr(trajectory, name).shape != shape:
                raise LearningError(
                    f"trajectory: {name}: expected {shape}, got {getattr(trajectory, name).shape}",
                    code="learning.size",
                )
        if not 1 <= steps < self.capacity:
            raise LearningError(
                f"trajectory: expected 1 to {self.capacity - 1} steps, got {steps}",
                code="learning.size",
            )
        if not 0 <= trajectory.hand_index < n_objects:
            raise LearningError(
                f"trajectory: hand_index: expected one of {n_objects}, got {trajectory.hand_index}",
                code="learning.size",
            )

    def _write(self, trajectory: Trajectory, program: int, marks: Marks) -> None:
        if not self.arrays:
            self._allocate(trajectory.objects.shape[1])
        steps = len(trajectory)
        index = (self.head + np.arange(steps + 1)) % self.capacity
        arrays, last = self.arrays, index[-1]
        arrays["objects"][index] = hand_first(trajectory.objects, trajectory.hand_index)
        arrays["arm"][index] = trajectory.arm
        arrays["action"][index[:-1]] = trajectory.actions
        arrays["reward"][index[:-1]] = trajectory.rewards
        arrays["program"][index] = program
        arrays["terminal"][index] = False
        arrays["terminal"][index[-2]] = trajectory.terminated
        arrays["last"][index] = False
        arrays["last"][last] = True
        arrays["action"][last] = arrays["reward"][last] = 0.0
        arrays["satisfied"][index], arrays["present"][index] = marks.satisfied, marks.present
        if marks.rewards is not None:
            arrays["goal_reward"][index] = marks.rewards
        self.head = int(last + 1) % self.capacity
        self.rows = max(self.rows, min(self.capacity, int(index.max()) + 1))


def hand_first(objects: NDArray[np.float32], hand_index: int) -> NDArray[np.float32]:
    """Move the hand to index 0 of axis -2, keeping the order of the others."""
    if hand_index == 0:
        return objects
    others = [i for i in range(objects.shape[-2]) if i != hand_index]
    return objects[..., [hand_index, *others], :]
