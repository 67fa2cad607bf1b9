"""Hindsight: stored transitions under other programs, with places moved to where a block later was.

Not in the paper. Places influence nothing, so a stored transition is exactly valid with a place
moved anywhere (Andrychowicz et al. 2017). Before a block moves, every such program is satisfied
already, so half of what is drawn is about blocks that moved. A place at times goes to where another
block went: places near the named block would not tell which block a program names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32, Float64
from pa_ros.core.update import HAND_INDEX
from pa_ros.language import HAND, Or, Program
from pa_ros.learning.config import HindsightConfig
from pa_ros.learning.errors import LearningError
from pa_ros.learning.replay_buffer.buffer import Column, Int64, ReplayBuffer
from pa_ros.learning.rules.all_goals import published
from pa_ros.learning.rules.kinds import Kinds
from pa_ros.learning.rules.rule import Drawn, Int32, Rule, Scenes
from pa_ros.learning.rules.seen import SeenSets
from pa_ros.world import Scoring, Trajectory
from pa_ros.world.poses import POSE_WIDTH, in_base, in_hand
from pa_ros.world.programs import ProgramTable
from pa_ros.world.relation import RELATIONS
from pa_ros.world.world import World

Bools = NDArray[np.bool_]
Bits = NDArray[np.uint8]  # eight programs in each, the first one in the lowest bit

RARITY = 8.0  # beside one other program, one whose target has a body is drawn once in nine times
# Where something is to rest, at any height: half of the moved places are where it was at the end,
# and they are moved less.
LAST, RESTS_SPREAD_M, RESTS_RARITY = 0.5, 0.008, 2.0
MOVED_M = 0.02  # a block that went farther than this in a trajectory has moved


class Moved(Drawn):
    """Drawn transitions whose places may be elsewhere than they were."""

    def __init__(self, replay: ReplayBuffer, index: Int64, discount: Float32) -> None:
        arrays = replay.arrays
        program, reward = arrays["program"][index], arrays["reward"][index]
        super().__init__(replay, index, program[:, None], reward[:, None], discount)
        scenes = super().scenes(slice(None))
        self.objects, self.arm, self.next_objects, self.next_arm = scenes

    def scenes(self, part: slice) -> Scenes:
        return self.objects[part], self.arm[part], self.next_objects[part], self.next_arm[part]


class Hindsight(Rule):
    """Draws transitions with one of P programs each: the training programs, then those in which one
    argument is an OR of two of theirs."""

    def __init__(
        self,
        programs: Sequence[Program],
        world: World,
        scoring: Scoring,
        config: HindsightConfig,
        discount: float = 0.0,
    ) -> None:
        super().__init__(discount)
        joined = {
            (i, j): either
            for i, j in combinations(range(len(programs)), 2)
            if (either := _either(programs[i], programs[j])) is not None
        }
        self.programs = (*programs, *joined.values())
        self._table = ProgramTable(world.vocabulary, self.programs)
        self._joined = np.full((len(programs), len(programs)), -1, np.int32)  # rows of ORs
        for row, (i, j) in enumerate(joined, start=len(programs)):
            self._joined[i, j] = self._joined[j, i] = row
        self._world, self._scoring, self._config = world, scoring, config
        kinds = Kinds(world)
        of_kinds = kinds.sets(self._table)
        sets = np.stack([of_kinds.moved, of_kinds.target], 1)[: len(programs)]  # [P, 2, kinds]
        self._count = len(programs)
        self._sets: Bits = np.packbits(sets, axis=0, bitorder="little")  # [P / 8, 2, kinds]
        self._body = world.schema.bodies(kinds.features)  # [kinds]
        self._seen = None if world.schema.tells_words else SeenSets(programs, world, scoring)
        self._relations = self._table.compiled().relation
        # How far below what rests on it a target is, by relation; NaN: it keeps its height.
        rests = [RELATIONS[name].rests_m for name in world.relations]
        self._rests_m = np.array([np.nan if below is None else below for below in rests])
        self._rest = bool(np.isfinite(self._rests_m).any())
        hand = len(world.vocabulary.words)  # its register
        self._hand_moves = self._table.compiled().moved == hand
        self._of_hand: Bits = np.packbits(self._hand_moves[: len(programs)], bitorder="little")
        # A target that has a body is not moved afterwards, so hardly any transition satisfies a
        # program that names it. Agents did not learn where these were drawn as often as others.
        to_place = (sets[:, 1] & ~self._body).any(-1)
        self._rare = ~to_place & ~self._hand_moves[: len(programs)]  # [P]
        self._kinds = kinds
        self.columns = {
            "left": Column(np.int32),  # transitions from this row to the trajectory's end
            "moved": Column(np.bool_, of_objects=True),  # which blocks moved in its trajectory
        }
        if self._seen is None:
            self.columns["kind"] = Column(np.int16, of_objects=True)  # see rules.kinds
        else:  # bit j: the first, the second set of program j may contain the object
            self.columns["sets"] = Column(np.uint64, (2,), of_objects=True)
            self.columns["body"] = Column(np.bool_, of_objects=True)

    def describe(self, trajectory: Trajectory) -> dict[str, Any]:
        described = {
            "left": np.arange(len(trajectory), -1, -1),
            "moved": moved_objects(trajectory, self._world),
        }
        if self._seen is None:
            return {**described, "kind": self._kinds.of(trajectory.objects)}
        measures = published(trajectory.measures, len(trajectory) + 1, self._count)
        poses = self._world.hand_pose(trajectory.arm)
        sets = self._seen(trajectory.objects, trajectory.hand_index, poses, measures)
        bits = np.uint64(1) << np.arange(len(sets), dtype=np.uint64)
        described["sets"] = np.einsum("psn,p->ns", sets.astype(np.uint64), bits)
        described["body"] = self._world.schema.bodies(trajectory.objects[0])
        return described

    def draw(self, rng: np.random.Generator, replay: ReplayBuffer, size: int) -> Moved:
        """Draw transitions, programs and places. A transition whose scene none of the programs fits
        keeps its own program and reward."""
        index, block = self._rows(rng, replay, size)
        drawn = Moved(replay, index, self.discounts(replay, index))
        every = np.arange(size)
        sets, bodies = self._sets_of(replay, index)
        named, of_block = np.bitwise_or.reduce(sets, 2), sets[:, :, block, every]  # [P / 8, 2, B]
        fits = self._programs(named[:, 0] & named[:, 1])
        about = self._programs(of_block[:, 0] | of_block[:, 1])
        wanted = fits & (about | (block == HAND_INDEX)[:, None])
        # No program is about the block that moved: then any that fits the scene.
        wanted = np.where(wanted.any(-1, keepdims=True), wanted, fits)
        keys = rng.random(wanted.shape)
        keys[:, self._rare] **= RESTS_RARITY if self._rest else RARITY
        program = _one_of(keys, wanted)
        chosen = _of_program(sets, program, every)
        # At times also another program that fits, joined by OR.
        others = fits & (self._joined[program] >= 0)
        rows = np.flatnonzero(others.any(-1) & (rng.random(size) < self._config.either))
        other = _one_of(rng.random((len(rows), others.shape[1])), others[rows])
        chosen[rows] |= _of_program(sets, other, rows)
        program[rows] = self._joined[program[rows], other]
        self._move_places(rng, replay, drawn, program, chosen, bodies, block)
        known = fits.any(-1, keepdims=True)
        reward = self._reward(drawn, program, chosen)
        drawn.program = np.where(known, program[:, None], drawn.program)
        drawn.reward = np.where(known, reward[:, None], drawn.reward)
        return drawn

    def rewards(self, replay: ReplayBuffer, rows: Int64, program: Int32) -> Float32:
        """Raises LearningError: a reward is true of a transition with its moved places alone."""
        raise LearningError("rewards: expected a rule that leaves places where they were")

    def _rows(
        self, rng: np.random.Generator, replay: ReplayBuffer, size: int
    ) -> tuple[Int64, Int64]:
        """Rows [B], and for each the block that moved which its program must be about, or the hand
        if any program will do."""
        index, block = replay.sample(rng, size), np.full(size, HAND_INDEX)
        filled = replay.filled()
        moved = np.flatnonzero(filled["moved"].any(-1) & ~filled["last"])
        if len(moved):
            about_moved = np.flatnonzero(rng.random(size) < self._config.moved)
            index[about_moved] = moved[rng.integers(len(moved), size=len(about_moved))]
            which = replay.arrays["moved"][index[about_moved]]  # [M, N]
            block[about_moved] = (which * rng.random(which.shape)).argmax(-1)
        return index, block

    def _sets_of(self, replay: ReplayBuffer, index: Int64) -> tuple[Bits, Bools]:
        """The two sets of every program in rows [B], [P / 8, 2, N, B], and what has a body,
        [B, N]."""
        if self._seen is not None:
            bits = replay.arrays["sets"][index]  # [B, N, 2]
            octets = bits.astype("<u8").view(np.uint8).reshape(*bits.shape, 8)
            sets, bodies = octets.T[: len(self._of_hand)].copy(), replay.arrays["body"][index]
        else:
            kinds = replay.arrays["kind"][index]  # [B, N]
            sets, bodies = self._sets.take(kinds.T, -1), self._body[kinds]
        sets[:, 0] &= ~self._of_hand[:, None, None]
        sets[:, 0, HAND_INDEX], sets[:, 1, HAND_INDEX] = self._of_hand[:, None], 0
        return sets, bodies

    def _programs(self, bits: Bits) -> Bools:
        """Which programs have their bit set, [B, P], of [P / 8, B]."""
        flags = np.unpackbits(bits, axis=0, count=self._count, bitorder="little")
        return flags.T.astype(np.bool_)

    def _move_places(
        self,
        rng: np.random.Generator,
        replay: ReplayBuffer,
        drawn: Moved,
        program: Int32,
        sets: Bools,
        bodies: Bools,
        moved: Int64,
    ) -> None:
        """Move a place that a program names to where what it moves later was, or another block.

        `sets` are the program's, [B, 2, N]; `bodies` [B, N] says what has a body; `moved` [B] is
        the block for which the program was drawn, or the hand.
        """
        config, every = self._config, np.arange(len(sets))
        # Only places may be moved afterwards: a block elsewhere would have changed what happened.
        places = sets[:, 1] & ~bodies
        rows = np.flatnonzero(places.any(-1) & (rng.random(len(sets)) < config.future))
        if not len(rows):
            return
        place = (places[rows] * rng.random(places[rows].shape)).argmax(-1)
        who = (sets[rows, 0] * rng.random(places[rows].shape)).argmax(-1)
        who = np.where(sets[rows, 0, moved[rows]], moved[rows], who)
        others = bodies[rows]
        others[:, HAND_INDEX] = False
        others[every[: len(rows)], who] = False
        another = (others * rng.random(others.shape)).argmax(-1)
        cross = (rng.random(len(rows)) < config.cross) & others.any(-1)
        who = np.where(cross, another, who)
        # A later step of the same episode, or this transition's end.
        left = replay.arrays["left"][drawn.index[rows]]
        later = drawn.index[rows] + 1 + (rng.random(len(rows)) * left).astype(np.int64)
        rests_m = self._rests_m[self._relations[program[rows]]]
        rests = np.isfinite(rests_m)
        if self._rest:
            end = drawn.index[rows] + left
            # Nothing rests in the air: rather where it was at the end, than while it was held.
            held = self._hand(replay.arrays["arm"][later % replay.capacity])[:, -1] > 0
            later = np.where(rests & (held | (rng.random(len(rows)) < LAST)), end, later)
        later %= replay.capacity
        there = replay.arrays["objects"][later, who, :POSE_WIDTH].astype(np.float64)
        there = in_base(self._hand(replay.arrays["arm"][later]), there)
        hand, next_hand = self._hand(drawn.arm[rows]), self._hand(drawn.next_arm[rows])
        pose = in_base(hand, drawn.objects[rows, place, :POSE_WIDTH].astype(np.float64))
        spread = np.where(rests, RESTS_SPREAD_M, config.spread)[:, None]
        pose[:, :2] = there[:, :2] + rng.normal(0.0, spread, (len(rows), 2))
        height = there[:, 2] if config.in_air else pose[:, 2]
        pose[:, 2] = np.where(rests, there[:, 2] - rests_m, height)
        drawn.objects[rows, place, :POSE_WIDTH] = in_hand(hand, pose)
        drawn.next_objects[rows, place, :POSE_WIDTH] = in_hand(next_hand, pose)

    def _reward(self, drawn: Moved, program: Int32, sets: Bools) -> Float32:
        """Rewards [B] by the verifier's rule, of programs with their sets [B, 2, N]."""
        size, _, n_objects = sets.shape
        reward, nearest = np.zeros(size, np.float32), np.full(size, np.inf)
        poses, hands = drawn.next_objects[..., :POSE_WIDTH], self._hand(drawn.next_arm)
        hand_moves, relation = self._hand_moves[program], self._relations[program]
        pairs = sets[:, 0, :, None] & sets[:, 1, None] & ~np.eye(n_objects, dtype=np.bool_)
        row, first, second = np.nonzero(pairs)
        for number, name in enumerate(self._world.relations):
            for of_hand in (True, False):
                asked = (relation == number) & (hand_moves == of_hand)
                part = np.flatnonzero(asked[row])
                rows = row[part]
                moved = None if of_hand else poses[rows, first[part], None]
                objects = poses[rows, second[part], None]
                measures = self._scoring.measures(name, objects, hands[rows], moved)
                np.minimum.at(nearest, rows, measures[:, 0])
                score = self._scoring.of_measure(nearest[asked], name, between=not of_hand)
                reward[asked] = score.reward
        return reward

    def _hand(self, arm: Float32) -> Float64:
        return self._world.hand_pose(arm).astype(np.float64)


def moved_objects(trajectory: Trajectory, world: World) -> Bools:
    """Which objects are elsewhere at a trajectory's end, the hand not counted: [N]."""
    hand, objects = world.hand_pose(trajectory.arm[[0, -1], None]), trajectory.objects[[0, -1]]
    poses = in_base(hand.astype(np.float64), objects[..., :POSE_WIDTH].astype(np.float64))
    first, last = poses[..., :3]
    moved: Bools = np.linalg.norm(last - first, axis=-1) > MOVED_M
    moved[trajectory.hand_index] = False
    return moved


def _of_program(sets: Bits, program: Int32, rows: Int64) -> Bools:
    """The sets [P / 8, 2, N, B] of one program for each of some rows, [rows, 2, N]."""
    bits = sets[program >> 3, :, :, rows] >> (program & 7).astype(np.uint8)[:, None, None]
    return (bits & 1).astype(np.bool_)


def _one_of(keys: Float64, wanted: Bools) -> Int32:
    """A column of each row [B, P] that is wanted, [B]: that with the largest key."""
    return np.asarray(np.where(wanted, keys, -1.0).argmax(-1), np.int32)


def _either(one: Program, two: Program) -> Program | None:
    """The program that an OR in one argument makes of two that differ in that argument alone."""
    if one.relation != two.relation:
        return None
    if one.moved == two.moved:
        return replace(one, target=Or((one.target, two.target)))
    if one.target == two.target and HAND not in (one.moved, two.moved):
        return replace(one, moved=Or((one.moved, two.moved)))
    return None
