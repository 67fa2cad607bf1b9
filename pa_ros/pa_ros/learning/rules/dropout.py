"""Property dropout: at times a block of a sampled transition does not show all of its properties.

Not in the paper. Training does not determine what detectors say of a block that shows no known
property: their biases decide, and they make such a block as likely RED as not. Blocks that a drawn
program names keep their properties, so rewards stay as they are; all other blocks must be ignored,
whatever they look like.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32
from pa_ros.core.update import HAND_INDEX
from pa_ros.learning.replay_buffer.buffer import Int64, ReplayBuffer
from pa_ros.learning.rules.kinds import Kinds
from pa_ros.learning.rules.rule import Drawn, Int32, Rule, Scenes
from pa_ros.world import Trajectory
from pa_ros.world.programs import ProgramTable
from pa_ros.world.world import World


class PropertyDropout(Rule):
    """Another rule, which also hides properties of blocks that none of a batch's programs names.

    Every set of property groups is as likely to be hidden (of shape and color: one, both, other).
    Where features do not tell what a program names, the rule stores it in the column `may_name`.
    """

    def __init__(self, rule: Rule, table: ProgramTable, world: World, probability: float) -> None:
        """`table`: whose rows the programs of a batch are."""
        self._rule, self.columns, self.programs = rule, rule.columns, rule.programs
        self._table, self._schema, self._probability = table, world.schema, probability
        self._named: NDArray[np.bool_] = np.zeros((0, 0), np.bool_)
        self._kinds = None if "may_name" in rule.columns else Kinds(world)
        groups = len(world.schema.groups)
        sets = np.arange(1, 2**groups)
        gray = np.append(sets ^ sets >> 1, 0)  # neighbours differ in one group; the last is empty
        self._hidden = (gray[:, None] >> np.arange(groups) & 1).astype(np.bool_)
        self._ends = (sets / len(sets)).astype(np.float32)

    def describe(self, trajectory: Trajectory) -> Mapping[str, Any]:
        return self._rule.describe(trajectory)

    def rewards(self, replay: ReplayBuffer, rows: Int64, program: Int32) -> Float32:
        return self._rule.rewards(replay, rows, program)

    def draw(self, rng: np.random.Generator, replay: ReplayBuffer, size: int) -> Drawn:
        drawn = self._rule.draw(rng, replay, size)
        return _Hiding(drawn, rng.random((size, 2), np.float32), self)

    def hide(
        self,
        drawn: Float32,
        objects: Float32,
        following: Float32,
        program: Int32,
        may_name: NDArray[np.uint64] | None = None,
    ) -> None:
        """Clear properties of at most one block of each transition, before and after it, in place.

        `drawn` is [B, 2] of [0, 1): which groups, if any, and of which block. `objects` and
        `following` are [B, N, F], `program` is [B, K], rows of the table. `may_name` [B, N], where
        features do not tell what a program names, are bits of the table's first programs.
        """
        free = ~(self._names(objects, program) if may_name is None else _bits(may_name, program))
        free[:, HAND_INDEX] = False
        count = free.sum(1)
        block = (free.cumsum(1) > (drawn[:, 1] * count).astype(np.int64)[:, None]).argmax(1)
        part = np.where(count > 0, drawn[:, 0] / self._probability, 1.0)  # 1 and more: nothing
        hidden = self._hidden[np.searchsorted(self._ends, part, side="right")]  # [B, groups]
        for columns, of_group in zip(self._schema.slices.values(), hidden.T, strict=True):
            rows = np.flatnonzero(of_group)
            objects[rows, block[rows], columns] = 0.0
            following[rows, block[rows], columns] = 0.0

    def _names(self, objects: Float32, program: Int32) -> NDArray[np.bool_]:
        """Blocks that one of a transition's programs names, [B, N]."""
        assert self._kinds is not None
        if len(self._named) != len(self._table):
            self._named = self._kinds.named(self._table)
        kind = self._kinds.of(objects)
        named = self._named[program[:, :, None], kind[:, None]]  # [B, K, N]
        return np.asarray(named.any(1))


class _Hiding(Drawn):
    """Drawn transitions, some of which hide properties."""

    def __init__(self, drawn: Drawn, chances: Float32, dropout: PropertyDropout) -> None:
        super().__init__(drawn.replay, drawn.index, drawn.program, drawn.reward, drawn.discount)
        self._drawn, self._chances, self._dropout = drawn, chances, dropout

    def scenes(self, part: slice) -> Scenes:
        scenes = self._drawn.scenes(part)
        bits = self.replay.arrays.get("may_name")
        may_name = None if bits is None else bits[self.index[part]]
        objects, next_objects = scenes[0], scenes[2]
        self._dropout.hide(self._chances[part], objects, next_objects, self.program[part], may_name)
        return scenes


def _bits(may_name: NDArray[np.uint64], program: Int32) -> NDArray[np.bool_]:
    """Blocks that one of a transition's programs may name, [B, N]; all for a program without a
    bit."""
    shift = np.minimum(program, 63).astype(np.uint64)[:, :, None]
    named = (may_name[:, None] >> shift & np.uint64(1)).astype(np.bool_)
    return np.asarray((named | (program >= 64)[:, :, None]).any(1))
