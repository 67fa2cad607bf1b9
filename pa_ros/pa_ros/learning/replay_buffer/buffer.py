"""The replay buffer: observations in a ring of preallocated arrays (paper, appendix: 1M frames).

One row per observation. The transition of row r leads to the next row of the ring, unless row r is
the last of its trajectory. Five objects take about 0.42 KB per row; memory is used as rows fill.
The learning rule (`pa_ros.learning.rules`) declares further columns, and fills them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pa_ros.learning.errors import LearningError
from pa_ros.learning.replay_buffer.ledger import Ledger
from pa_ros.world import Trajectory
from pa_ros.world.world import World

# Bounds of absolute values. Metres, rad/s and one-hots of any arena are far below, and an update
# with such numbers stays finite.
LARGEST = {"objects": 1e4, "arm": 1e4, "actions": 1.0, "rewards": 1e6}
Int64 = NDArray[np.int64]


class Column(NamedTuple):
    """What is stored of each row: numbers [*shape], or [N, *shape] with `of_objects`."""

    dtype: Any
    shape: tuple[int, ...] = ()
    of_objects: bool = False


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
        columns: Mapping[str, Column] | None = None,
    ) -> None:
        """`columns`: what the learning rule stores, by name."""
        self.capacity, self.world = capacity, world
        self.ledger = Ledger()
        self.rows = 0  # filled
        self.head = 0  # next row to be written
        self.arrays: dict[str, NDArray[Any]] = {}
        self.columns = {
            "objects": Column(np.float32, (world.object_features,), of_objects=True),
            "arm": Column(np.float32, (world.arm_features,)),
            "action": Column(np.float32, (world.actions,)),
            "reward": Column(np.float32),
            "program": Column(np.int32),
            "last": Column(np.bool_),  # last row of its trajectory: no transition starts here
            "terminal": Column(np.bool_),  # its transition ends the task, not just the time
            **(columns or {}),
        }
        self._n_is_known = world.schema.tells_words
        """Whether every scene has the same number of objects."""
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

    def insert(
        self, trajectory: Trajectory, program: int, described: Mapping[str, Any] | None = None
    ) -> None:
        """Store a new trajectory that `check` accepts.

        `program` is the row of its program in the learner's table, `described` what the rule's
        columns say of its T + 1 rows: arrays [T + 1, ...], or without the first axis what is the
        same in all rows. Objects are in the trajectory's order.
        """
        self.ledger.record(trajectory.key, trajectory.held_from, trajectory.first_of_run)
        n_objects = trajectory.objects.shape[1]
        if not self.arrays:
            self._allocate(n_objects)
        elif n_objects > self.arrays["objects"].shape[1]:
            self._grow(n_objects)
        # The ring overwrites the oldest rows. What stays of an older trajectory is still valid,
        # since a transition needs only the next row.
        index = (self.head + np.arange(len(trajectory) + 1)) % self.capacity
        arrays, last = self.arrays, index[-1]
        for name, values in {"objects": trajectory.objects, **(described or {})}.items():
            arrays[name][index] = self._ordered(name, np.asarray(values), trajectory.hand_index)
        arrays["arm"][index] = trajectory.arm
        arrays["action"][index[:-1]] = trajectory.actions
        arrays["reward"][index[:-1]] = trajectory.rewards
        arrays["program"][index] = program
        arrays["terminal"][index] = False
        arrays["terminal"][index[-2]] = trajectory.terminated
        arrays["last"][index] = False
        arrays["last"][last] = True
        arrays["action"][last] = arrays["reward"][last] = 0.0
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

    def following(self, index: Int64) -> Int64:
        """Row that the transition of each row leads to."""
        return (index + 1) % self.capacity

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

    def _ordered(self, name: str, values: NDArray[Any], hand_index: int) -> NDArray[Any]:
        """A column's values with the hand as the first of as many objects as are stored."""
        column = self.columns[name]
        if not column.of_objects:
            return values
        axis = values.ndim - 1 - len(column.shape)
        values = hand_first(values, hand_index, axis)
        return _repeated(values, self.arrays["objects"].shape[1], axis)

    def _grow(self, n_objects: int) -> None:
        """Store scenes of so many objects from now on."""
        filled = self.filled()
        self._allocate(n_objects)
        for name, old in filled.items():
            of_objects = self.columns[name].of_objects
            self.arrays[name][: self.rows] = _repeated(old, n_objects, 1) if of_objects else old

    def _allocate(self, n_objects: int) -> None:
        try:
            self.arrays = {
                name: np.zeros((self.capacity, *[n_objects] * of_objects, *shape), dtype)
                for name, (dtype, shape, of_objects) in self.columns.items()
            }
        except MemoryError as error:
            raise LearningError(
                f"replay: expected memory for {self.capacity} frames of {n_objects} objects "
                f"(capacity_frames), got none: {error}",
                code="learning.size",
            ) from error


def _repeated(values: NDArray[Any], count: int, axis: int) -> NDArray[Any]:
    """`count` objects on an axis with fewer or as many: the last one is repeated."""
    there = values.shape[axis]
    return values if there == count else values.take(np.minimum(np.arange(count), there - 1), axis)


def hand_first(values: NDArray[Any], hand_index: int, axis: int) -> NDArray[Any]:
    """Move the hand to index 0 of an axis of objects, keeping the order of the others."""
    others = [i for i in range(values.shape[axis]) if i != hand_index]
    return values.take([hand_index, *others], axis)
