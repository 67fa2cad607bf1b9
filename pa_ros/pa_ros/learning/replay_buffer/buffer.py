"""The replay buffer: observations in a ring of preallocated arrays (paper, appendix: 1M frames).

One row per observation. The transition of row r leads to the next row of the ring, unless row r is
the last of its trajectory. Five objects take about 0.42 KB per row; memory is used as rows fill.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.update import HAND_INDEX
from pa_ros.learning.errors import LearningError
from pa_ros.learning.relabeling.all_goals import GoalMasks
from pa_ros.learning.relabeling.kinds import Kinds
from pa_ros.learning.replay_buffer.ledger import Ledger
from pa_ros.world import Trajectory
from pa_ros.world.poses import POSE_WIDTH, in_base
from pa_ros.world.world import World

# Bounds of absolute values. Metres, rad/s and one-hots of any arena are far below, and an update
# with such numbers stays finite.
LARGEST = {"objects": 1e4, "arm": 1e4, "actions": 1.0, "rewards": 1e6}
MOVED_M = 0.02  # a block that went farther than this in a trajectory has moved
Int64 = NDArray[np.int64]
NO_GOALS = GoalMasks(np.zeros((), np.uint64), 0)


class ReplayBuffer:
    """Ring of the latest `capacity` observations of scenes with `n_objects` objects.

    The hand is stored first, whatever its index outside. If the number of objects is not given, the
    first trajectory fixes it. Where objects are found by a sensor, their number varies: it grows to
    the largest, and in scenes with fewer objects the last one is stored again.
    """

    def __init__(
        self,
        capacity: int,
        world: World,
        n_objects: int | None = None,
        goals: int = 0,
    ) -> None:
        """`goals`: number of relabeling programs whose rewards are stored in every row."""
        self.capacity, self._goals = capacity, goals
        self.world = world
        self.ledger = Ledger()
        self.rows = 0  # filled
        self.head = 0  # next row to be written
        self.arrays: dict[str, NDArray[Any]] = {}
        self._moves = world.vocabulary.moves_objects
        self._n_is_known = world.schema.tells_words
        """Whether every scene has the same number of objects."""
        self._kinds = Kinds(world) if self._moves and self._n_is_known else None
        self._moved_rows: Int64 | None = None  # until the next insertion
        if n_objects is not None:
            self._allocate(n_objects)

    def reward_per_step(self, rows: int = 2000) -> float:
        """Mean reward of the transitions in the newest rows; the buffer must not be empty."""
        newest = (self.head - 1 - np.arange(min(rows, self.rows))) % self.capacity
        begins = ~self.arrays["last"][newest]
        return float(self.arrays["reward"][newest][begins].mean())

    def check(self, trajectory: Trajectory) -> None:
        """Raise LearningError unless the trajectory is one of this world that fits the buffer.

        Its arrays' shapes fit each other already: its maker, or the decoder of the message, saw to
        that.
        """
        if trajectory.world_digest != self.world.digest:
            raise LearningError(
                f"trajectory: expected world {self.world.digest}, "
                f"got {trajectory.world_digest} from {trajectory.agent_id!r}",
                code="learning.world",
            )
        found = trajectory.objects.shape[1]
        n_objects = self.arrays["objects"].shape[1] if self.arrays else found
        if found != n_objects and self._n_is_known:
            raise LearningError(
                f"trajectory: expected {n_objects} objects, got {found}", code="learning.size"
            )
        if not 1 <= len(trajectory) < self.capacity:
            raise LearningError(
                f"trajectory: expected 1 to {self.capacity - 1} steps, got {len(trajectory)}",
                code="learning.size",
            )
        for name, bound in LARGEST.items():
            largest = np.abs(getattr(trajectory, name)).max()
            if not largest <= bound:  # so that NaN is rejected, too
                raise LearningError(
                    f"trajectory: {name}: expected numbers in [-{bound:g}, {bound:g}], "
                    f"got ±{largest:g} from {trajectory.agent_id!r}",
                    code="learning.out_of_bounds",
                )

    def insert(self, trajectory: Trajectory, program: int, goals: GoalMasks = NO_GOALS) -> None:
        """Store a new trajectory that `check` accepts.

        `program` is the row of its program in the learner's table, `goals` the relabeler's masks
        of its T + 1 rows.
        """
        self.ledger.record(trajectory.key, trajectory.held_from, trajectory.first_of_run)
        n_objects = trajectory.objects.shape[1]
        if not self.arrays:
            self._allocate(n_objects)
        elif n_objects > self.arrays["objects"].shape[1]:
            self._grow(n_objects)
        n_objects = self.arrays["objects"].shape[1]
        # The ring overwrites the oldest rows. What stays of an older trajectory is still valid,
        # since a transition needs only the next row.
        index = (self.head + np.arange(len(trajectory) + 1)) % self.capacity
        arrays, last = self.arrays, index[-1]
        objects = hand_first(trajectory.objects, trajectory.hand_index)
        arrays["objects"][index] = _repeated(objects, n_objects)
        arrays["arm"][index] = trajectory.arm
        arrays["action"][index[:-1]] = trajectory.actions
        arrays["reward"][index[:-1]] = trajectory.rewards
        arrays["program"][index] = program
        arrays["terminal"][index] = False
        arrays["terminal"][index[-2]] = trajectory.terminated
        arrays["last"][index] = False
        arrays["last"][last] = True
        arrays["action"][last] = arrays["reward"][last] = 0.0
        arrays["satisfied"][index], arrays["present"][index] = goals.satisfied, goals.present
        if goals.rewards is not None:
            arrays["goal_reward"][index] = goals.rewards
        if goals.may_name is not None:
            may_name = hand_first(goals.may_name[:, None], trajectory.hand_index)
            arrays["may_name"][index] = _repeated(may_name, n_objects)[:, 0]
        if goals.sets is not None:
            sets = hand_first(goals.sets, trajectory.hand_index)
            arrays["sets"][index] = _repeated(sets, n_objects)
            arrays["body"][index] = self.world.schema.bodies(arrays["objects"][index[0]])
        if self._moves:
            if self._kinds is not None:
                arrays["kind"][index] = self._kinds.of(arrays["objects"][index])
            arrays["left"][index] = np.arange(len(trajectory), -1, -1)
            arrays["moved"][index] = moved_objects(arrays["objects"][index], trajectory.arm)
            self._moved_rows = None
        self.head = int(last + 1) % self.capacity
        self.rows = max(self.rows, min(self.capacity, int(index.max()) + 1))

    def sample(self, rng: np.random.Generator, size: int) -> Int64:
        """Draw rows [size] of transitions, uniformly and with replacement."""
        if self.rows == 0:
            raise LearningError(
                "replay: expected transitions, got an empty buffer", code="learning.empty_replay"
            )
        index = rng.integers(self.rows, size=size)
        last = self.arrays["last"]
        # Drawing again keeps the draw uniform, and few rows are the last of their trajectory.
        while (again := np.flatnonzero(last[index])).size:
            index[again] = rng.integers(self.rows, size=again.size)
        return index

    def may_name(self, index: Int64) -> NDArray[np.uint64] | None:
        """Bits of the relabeling programs that may name each object of rows, [B, N]; None where
        features tell it."""
        stored = self.arrays.get("may_name")
        return None if stored is None else stored[index]

    def following(self, index: Int64) -> Int64:
        """Row that the transition of each row leads to."""
        return (index + 1) % self.capacity

    @property
    def moved_rows(self) -> Int64:
        """Rows of transitions from trajectories in which a block moved."""
        if self._moved_rows is None:
            moved = self.arrays["moved"][: self.rows].any(-1)
            self._moved_rows = np.flatnonzero(moved & ~self.arrays["last"][: self.rows])
        return self._moved_rows

    def filled(self) -> dict[str, NDArray[Any]]:
        """Views of the rows in use; with `to_metadata`, everything to save."""
        return {name: array[: self.rows] for name, array in self.arrays.items()}

    def to_metadata(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {"rows": self.rows, "head": self.head, "ledger": self.ledger.to_metadata()}

    def restore(self, arrays: dict[str, NDArray[Any]], values: dict[str, Any]) -> None:
        """The inverse of `filled` and `to_metadata`, of a buffer of the same capacity."""
        self.rows, self.head = values["rows"], values["head"]
        if arrays:
            self._allocate(arrays["objects"].shape[1])
            for name, array in self.arrays.items():
                array[: self.rows] = arrays[name]
        self.ledger = Ledger.from_metadata(values["ledger"])

    def _grow(self, n_objects: int) -> None:
        """Store scenes of so many objects from now on."""
        filled = self.filled()
        self._allocate(n_objects)
        for name, old in filled.items():
            new = self.arrays[name][: self.rows]
            if name in ("objects", "sets"):
                new[:] = _repeated(old, n_objects)
            elif name in ("may_name", "moved", "body"):
                new[:] = _repeated(old[..., None], n_objects)[..., 0]
            else:
                new[:] = old

    def _allocate(self, n_objects: int) -> None:
        shapes: dict[str, tuple[tuple[int, ...], Any]] = {
            "objects": ((n_objects, self.world.object_features), np.float32),
            "arm": ((self.world.arm_features,), np.float32),
            "action": ((self.world.actions,), np.float32),
            "reward": ((), np.float32),
            "program": ((), np.int32),
            "last": ((), np.bool_),  # last row of its trajectory: no transition starts here
            "terminal": ((), np.bool_),  # its transition ends the task, not just the time
            "satisfied": ((), np.uint64),  # bit j: relabeling program j is satisfied at this row
            "present": ((), np.uint64),  # bit j: program j names an object of the scene
        }
        if self._moves:
            shapes["left"] = (), np.int32  # transitions from this row to the trajectory's end
            if self._kinds is not None:
                shapes["kind"] = (n_objects,), np.int16  # see relabeling.kinds
            else:  # bit j: the first, the second set of program j may contain the object
                shapes["sets"] = (n_objects, 2), np.uint64
                shapes["body"] = (n_objects,), np.bool_
            shapes["moved"] = (n_objects,), np.bool_  # which blocks moved in its trajectory
        elif not self.world.schema.tells_words:
            shapes["may_name"] = (n_objects,), np.uint64  # bit j: program j may name the object
        if self._goals:
            shapes["goal_reward"] = (self._goals,), np.float32  # of program j, at this row
        try:
            arrays = {k: np.zeros((self.capacity, *s), dtype) for k, (s, dtype) in shapes.items()}
        except MemoryError as error:
            raise LearningError(
                f"replay: expected memory for {self.capacity} frames of {n_objects} objects "
                f"(capacity_frames), got none: {error}",
                code="learning.size",
            ) from error
        self.arrays = arrays


def moved_objects(objects: NDArray[np.float32], arm: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which objects [T + 1, N, F] are elsewhere at the end, the hand not counted: [N]."""
    hand, poses = arm[[0, -1], None, -POSE_WIDTH:], objects[[0, -1], :, :POSE_WIDTH]
    first, last = in_base(hand.astype(np.float64), poses.astype(np.float64))[..., :3]
    moved: NDArray[np.bool_] = np.linalg.norm(last - first, axis=-1) > MOVED_M
    moved[HAND_INDEX] = False
    return moved


def _repeated(objects: NDArray[Any], count: int) -> NDArray[Any]:
    """`count` objects on axis -2, of which there are fewer: the last one is repeated."""
    which = np.minimum(np.arange(count), objects.shape[-2] - 1)
    return objects if objects.shape[-2] == count else objects[..., which, :]


def hand_first(objects: NDArray[Any], hand_index: int) -> NDArray[Any]:
    """Move the hand to index 0 of axis -2, keeping the order of the others."""
    if hand_index == 0:
        return objects
    others = [i for i in range(objects.shape[-2]) if i != hand_index]
    return objects[..., [hand_index, *others], :]
