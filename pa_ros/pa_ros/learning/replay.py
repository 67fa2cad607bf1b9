"""Replay buffer: observations in a ring of preallocated arrays (paper, appendix: 1M frames).

One row per observation. The transition of row r goes to the next row of the ring, unless row r is
the last of its stretch. Five objects take about 0.42 KB per row; memory is touched as rows fill.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import ARM_FEATURES, JOINTS, OBJECT_FEATURES, Stretch
from pa_ros.learning.errors import (
    EmptyReplayError,
    NonFiniteError,
    StretchSizeError,
    StretchVocabularyError,
)
from pa_ros.learning.ledger import Ledger

Int64 = NDArray[np.int64]
UInt64 = NDArray[np.uint64]


@dataclass(frozen=True, slots=True)
class InsertReport:
    """What became of one stretch."""

    accepted: bool  # False: (agent, sequence) was there already
    transitions: int  # now sampleable because of it
    missing: int  # stretches skipped and not arrived since, over all agents
    duplicates: int  # so far


class Replay:
    """Ring of the latest `capacity` observations of scenes with `n_objects` objects.

    The hand is stored first, whatever its index outside. The number of objects is fixed by the
    first stretch if it is not given.
    """

    def __init__(self, capacity: int, vocabulary_digest: str, n_objects: int | None = None) -> None:
        self.capacity = capacity
        self.vocabulary_digest = vocabulary_digest
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

    def check(self, stretch: Stretch) -> None:
        """Raise a StretchError unless the stretch can be inserted."""
        if stretch.vocabulary_digest != self.vocabulary_digest:
            raise StretchVocabularyError(
                f"stretch: expected vocabulary {self.vocabulary_digest}, "
                f"got {stretch.vocabulary_digest} from {stretch.agent_id!r}"
            )
        self._check_sizes(stretch)
        for name in ("objects", "arm", "actions", "rewards"):
            if not np.isfinite(getattr(stretch, name)).all():
                raise NonFiniteError(f"stretch: {name}: expected finite numbers")
        if np.abs(stretch.actions).max() > 1.0:
            largest = np.abs(stretch.actions).max()
            raise NonFiniteError(f"stretch: actions: expected [-1, 1], got ±{largest}")

    def insert(
        self, stretch: Stretch, program: int, satisfied: UInt64 | None = None, present: int = 0
    ) -> InsertReport:
        """Insert once: a second time is counted and changes nothing else.

        `program` is the row of the stretch's program in the learner's table; `satisfied` [T + 1]
        and `present` are the relabeling bits of `Relabeler.marks`.
        Raises a StretchError, leaving the replay as it was, if `check` does.
        """
        self.check(stretch)
        accepted = self.ledger.is_new(stretch.agent_id, stretch.sequence)
        if accepted:
            self.ledger.record(stretch.agent_id, stretch.sequence)
            self._write(stretch, program, satisfied, present)
        else:
            self.ledger.duplicates += 1
        transitions = len(stretch) if accepted else 0
        return InsertReport(accepted, transitions, self.ledger.missing, self.ledger.duplicates)

    def sample(self, rng: np.random.Generator, size: int) -> Int64:
        """Draw rows [size] of transitions, uniformly and with replacement."""
        if self.rows == 0:
            raise EmptyReplayError("replay: expected transitions, got an empty buffer")
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
        """The inverse of `filled` and `to_metadata`; StretchSizeError if they do not fit."""
        rows, head = int(values["rows"]), int(values["head"])
        if not (0 <= rows <= self.capacity and 0 <= head < self.capacity):
            raise StretchSizeError(f"replay: expected {self.capacity} rows, got {rows} at {head}")
        if arrays:
            self._allocate(arrays["objects"].shape[1])
            for name, array in self.arrays.items():
                if arrays[name].shape != (rows, *array.shape[1:]):
                    raise StretchSizeError(
                        f"replay: {name}: expected {rows} rows, got {arrays[name].shape}"
                    )
                array[:rows] = arrays[name]
        self.rows, self.head = rows, head
        self.ledger = Ledger.from_metadata(values["ledger"])

    def _allocate(self, n_objects: int) -> None:
        shapes: dict[str, tuple[tuple[int, ...], Any]] = {
            "objects": ((n_objects, OBJECT_FEATURES), np.float32),
            "arm": ((ARM_FEATURES,), np.float32),
            "action": ((JOINTS,), np.float32),
            "reward": ((), np.float32),
            "program": ((), np.int32),
            "last": ((), np.bool_),  # of its stretch: no transition starts here
            "terminal": ((), np.bool_),  # its transition ends the task, not just the time
            "satisfied": ((), np.uint64),  # bit j: relabeling program j, at this row
            "present": ((), np.uint64),  # bit j: program j names an object of the scene
        }
        self.arrays = {k: np.zeros((self.capacity, *s), dtype) for k, (s, dtype) in shapes.items()}

    def _check_sizes(self, stretch: Stretch) -> None:
        steps, found = len(stretch), stretch.objects.shape
        if len(found) != 3:
            raise StretchSizeError(f"stretch: objects: expected three dimensions, got {found}")
        n_objects = self.arrays["objects"].shape[1] if self.arrays else found[1]
        expected = {
            "objects": (steps + 1, n_objects, OBJECT_FEATURES),
            "arm": (steps + 1, ARM_FEATURES),
            "actions": (steps, JOINTS),
            "rewards": (steps,),
        }
        for name, shape in expected.items():
            if getattr(stretch, name).shape != shape:
                raise StretchSizeError(
                    f"stretch: {name}: expected {shape}, got {getattr(stretch, name).shape}"
                )
        if not 1 <= steps < self.capacity:
            raise StretchSizeError(f"stretch: expected 1 to {self.capacity - 1} steps, got {steps}")
        if not 0 <= stretch.hand_index < n_objects:
            raise StretchSizeError(
                f"stretch: hand_index: expected one of {n_objects}, got {stretch.hand_index}"
            )

    def _write(
        self, stretch: Stretch, program: int, satisfied: UInt64 | None, present: int
    ) -> None:
        if not self.arrays:
            self._allocate(stretch.objects.shape[1])
        steps = len(stretch)
        index = (self.head + np.arange(steps + 1)) % self.capacity
        arrays, last = self.arrays, index[-1]
        arrays["objects"][index] = hand_first(stretch.objects, stretch.hand_index)
        arrays["arm"][index] = stretch.arm
        arrays["action"][index[:-1]] = stretch.actions
        arrays["reward"][index[:-1]] = stretch.rewards
        arrays["program"][index] = program
        arrays["terminal"][index] = False
        arrays["terminal"][index[-2]] = stretch.terminated
        arrays["last"][index] = False
        arrays["last"][last] = True
        arrays["action"][last] = arrays["reward"][last] = 0.0
        arrays["satisfied"][index] = 0 if satisfied is None else satisfied
        arrays["present"][index] = present
        self.head = int(last + 1) % self.capacity
        self.rows = max(self.rows, min(self.capacity, int(index.max()) + 1))


def hand_first(objects: NDArray[np.float32], hand_index: int) -> NDArray[np.float32]:
    """Move the hand to index 0 of axis -2, keeping the order of the others."""
    if hand_index == 0:
        return objects
    others = [i for i in range(objects.shape[-2]) if i != hand_index]
    return objects[..., [hand_index, *others], :]
