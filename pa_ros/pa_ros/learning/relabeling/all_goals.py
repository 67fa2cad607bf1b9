"""All-goals relabeling: one stored transition, scored under several training programs.

Not in the paper. A transition does not depend on the program that was being executed, only its
reward does, and the verifier can say what that would have been under another program. Done once
per trajectory, as bits, so that drawing programs for a batch is a gather.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32
from pa_ros.language import Program, Vocabulary
from pa_ros.world.programs import ProgramTable, crisp
from pa_ros.world.properties import truth_matrix

MAX_PROGRAMS = 64  # bits of a mark

Int32 = NDArray[np.int32]
UInt64 = NDArray[np.uint64]


class Relabeler:
    """The P training programs, in order: program j is bit j of every mark, and row j of a batch."""

    def __init__(
        self, programs: Sequence[Program], vocabulary: Vocabulary, near_threshold: float
    ) -> None:
        if not 1 <= len(programs) <= MAX_PROGRAMS:
            raise ConfigError(
                f"relabeling: expected 1 to {MAX_PROGRAMS} programs, got {len(programs)}"
            )
        self._table = ProgramTable(vocabulary)
        for program in programs:
            self._table.add(program)
        self._truth = truth_matrix(vocabulary)
        self._near_threshold = near_threshold
        self._bits = np.arange(len(self._table), dtype=np.uint64)

    def marks(self, objects: Float32, hand_index: int) -> tuple[UInt64, int]:
        """Which programs each row satisfies, bits [T + 1], and which name something, bits.

        `objects` is [T + 1, N, 16] of one episode, where properties do not change. A program is
        satisfied where an object that it names crisply is nearer to the hand than the threshold:
        the verifier's rule, from positions in the hand's frame (m).
        """
        named = crisp(self._table.arrays(), (objects[0] @ self._truth).T, hand_index)  # [P, N]
        x, y, z = np.moveaxis(objects[..., :3].astype(np.float64), -1, 0)
        near = np.sqrt(x * x + y * y + z * z) <= self._near_threshold  # [T + 1, N]
        satisfied = (near[:, None] & named).any(-1)  # [T + 1, P]
        weights = np.uint64(1) << self._bits
        return satisfied @ weights, int(named.any(-1) @ weights)

    def draw(
        self,
        rng: np.random.Generator,
        original: Int32,
        reward: Float32,
        marks: tuple[UInt64, UInt64],
        k: int,
        keep_original: bool,
    ) -> tuple[Int32, Float32]:
        """Draw K programs, [B, K], and their rewards ±1, [B, K], for B transitions.

        Given the program that acted and its reward, [B], and the marks (satisfied at the next
        row, present), [B]. Programs present are drawn uniformly without replacement, and over
        again if they are fewer than K; with `keep_original` the one that acted comes first.
        """
        satisfied, present = (self._unpack(mark) for mark in marks)  # [B, P]
        own = original[:, None] == np.arange(len(self._bits))
        allowed = present & ~own if keep_original else present
        keys = rng.random(allowed.shape)
        order = np.argsort(np.where(allowed, keys, 2.0), axis=1)  # the allowed come first
        count = allowed.sum(1, keepdims=True)
        chosen = k - 1 if keep_original else k
        column = np.arange(chosen) % np.maximum(count, 1)  # [B, chosen]
        other = np.take_along_axis(order, column, 1).astype(np.int32)
        rewards = np.where(np.take_along_axis(satisfied, other, 1), 1.0, -1.0).astype(np.float32)
        program = np.where(count > 0, other, original[:, None])
        rewards = np.where(count > 0, rewards, reward[:, None])
        if keep_original:
            program = np.concatenate([original[:, None], program], 1)
            rewards = np.concatenate([reward[:, None], rewards], 1)
        return program, rewards

    def _unpack(self, bits: UInt64) -> NDArray[np.bool_]:
        return (bits[:, None] >> self._bits & np.uint64(1)).astype(np.bool_)
