"""Holding: programs that take a block, and put it on a place or on another block."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from math import inf

import numpy as np

from pa_ros.arena.conditions import Condition
from pa_ros.arena.config import ArenaConfig
from pa_ros.arena.designs import Design, Kind
from pa_ros.arena.episodes import Block, Episode, spots_for
from pa_ros.arena.kinematics import joints_at
from pa_ros.arena.pushing import LONGEST, Pushing
from pa_ros.arena.references import pointing_down, reach
from pa_ros.arena.simulation import HAND_INDEX
from pa_ros.arena.skills import SKILLS, DemoProgram
from pa_ros.arena.task import ReachTask
from pa_ros.core.experience import Float64
from pa_ros.language import parse_goal, roles
from pa_ros.language.syntax import HOLD, NEAR, ON, ROUND
from pa_ros.world.relation import BLOCK_M, GRIP_M, HELD_M
from pa_ros.world.schema import PLACE

UNDER_M = -BLOCK_M  # a place on the table is as high as a block under the table would be

# Starts of training: shares of episodes, and where the hand is. Lengths in m.
OVER_BLOCK, HOLDING, STACKED = 0.4, 0.2, 0.1
RAISED, PLACE_ON_BLOCK = 0.3, 0.3  # the target stands on another block; the place is on one
OVER_M, OVER_HEIGHT_M = 0.05, (0.14, 0.25)
CARRIED_HEIGHT_M = (0.18, 0.32)
TOWERS = (3, 4)  # blocks

# How the script takes and puts blocks.
CLEAR_M = 0.05  # between what it carries, or the hand, and what it passes over
OVER_IT_M, AT_IT_M = 0.02, 0.008  # sideways, before the hand goes down; to let go, along each axis
LOWERING_M = 0.09  # above where it is to be: a block that is lower is on its way down


class Holding(Pushing):
    """Takes blocks, and puts them on places and on other blocks."""

    preset = "hold"
    holds_blocks = True
    does = "takes blocks and puts them on places and on each other; it has a vacuum cup"

    def takes(self, relation: str, of_hand: bool, target: Kind) -> bool:
        """The hand comes near to things and holds blocks; blocks are put on what they rest on."""
        if of_hand:
            return relation == NEAR or (relation == HOLD and PLACE not in target.words)
        return relation == ON and target.words.isdisjoint(ROUND)

    def conditions(self, design: Design) -> Iterator[Condition]:
        """Those of pushing, with blocks that are taken, and towers."""
        for one in super().conditions(design):
            relation = ON if one.moved else NEAR
            targets = [k for k in one.targets if self.takes(relation, not one.moved, k)]
            if targets:
                yield replace(one, targets=tuple(targets), relations=(relation,))
        yield Condition("hold", design.train, design.pool, design.n_blocks, relations=(HOLD,))
        new = design.held_out or design.train
        yield Condition("hold-eval", new, design.pool, design.n_blocks, relations=(HOLD,))
        yield Condition("place", design.places, design.pool, design.n_blocks, moved=design.pool)
        flat = self._flat(design)
        for blocks in TOWERS:
            yield Condition(f"tower-{blocks}", flat, flat, blocks, moved=flat, chain=blocks)
        yield Condition("rebuild-3", flat, flat, 3, moved=flat, chain=3)
        yield Condition("sort-3", flat, flat, 3, moved=flat, chain=2)

    def draw(
        self,
        config: ArenaConfig,
        design: Design,
        condition: Condition,
        index: int,
        rng: np.random.Generator,
    ) -> Episode:
        """Half of the training episodes start with a part done."""
        plain = replace(condition, near_starts=0.0)
        episode = super().draw(config, design, plain, index, rng)
        blocks = [
            one if design.schema.has_body(one.kind) else replace(one, above_m=UNDER_M)
            for one in episode.blocks
        ]
        episode = replace(episode, blocks=tuple(blocks))
        if condition.chain:
            several, _ = condition.name.split("-")
            return SEVERAL[several](design, episode, rng)
        return _with_a_part_done(config, design, episode, rng) if condition.near_starts else episode

    def relate(self, task: ReachTask, moved: int, target: int) -> Float64:
        if moved == HAND_INDEX and task.program.relation == NEAR:
            return reach(task, task.simulation.positions[target])
        if moved == HAND_INDEX:
            return take(task, target)
        return put(task, moved, target)

    def demo(self, design: Design) -> list[DemoProgram]:
        """Programs that put blocks somewhere, and one that builds a tower."""
        *moves, _ = super().demo(design)
        low, middle, top = (kind.conjunction for kind in self._flat(design)[:3])
        tower = f"ALL({ON}({top}, {middle}), {ON}({middle}, {low}))"
        return [
            *(replace(one, farthest=inf) for one in moves),
            DemoProgram("tower", tower, 3, steps=2 * LONGEST),
        ]

    def _flat(self, design: Design) -> tuple[Kind, ...]:
        """Blocks on which others can rest."""
        return tuple(kind for kind in design.pool if self.takes(ON, of_hand=False, target=kind))


SKILLS.register("hold", Holding())


def take(task: ReachTask, block: int) -> Float64:
    """The command [J + 1] of the script that takes a block from above."""
    hand, place = task.simulation.positions[[HAND_INDEX, block]]
    above = place + (0.0, 0.0, GRIP_M)
    if _holds(task) and float(np.linalg.norm(hand - above)) < HELD_M:
        return _command(task, hand, on=True)
    over = float(np.hypot(*(above - hand)[:2])) < OVER_IT_M
    return _command(task, above if over else _clear(task, above), on=over and not _holds(task))


def put(task: ReachTask, block: int, support: int) -> Float64:
    """The command [J + 1] of the script that puts a block on another one, or on a place."""
    hand, place, under = task.simulation.positions[[HAND_INDEX, block, support]]
    if task.verifier.score(task.simulation.objects(), task.simulation.hand_pose).satisfied:
        return _command(task, np.array([*hand[:2], place[2] + GRIP_M + CLEAR_M]), on=False)
    if not _holds(task) or float(np.linalg.norm(hand - place - (0.0, 0.0, GRIP_M))) > HELD_M:
        return take(task, block)
    to = under + (0.0, 0.0, BLOCK_M) - place  # from where the block is to where it is to be
    beside, lowering = float(np.hypot(*to[:2])), -to[2] < LOWERING_M
    if beside > (OVER_IT_M if lowering else AT_IT_M):
        return _command(task, _clear(task, hand + to, BLOCK_M), on=True)
    return _command(task, hand + to, on=max(beside, abs(to[2])) > AT_IT_M)


def _clear(task: ReachTask, place: Float64, carried_m: float = 0.0) -> Float64:
    """Where the hand goes next on its way over a place: up, then over all blocks."""
    hand, *objects = task.simulation.positions
    grip = hand - (0.0, 0.0, GRIP_M)
    highest = max(one[2] for one in objects if np.linalg.norm(one - grip) > HELD_M or not carried_m)
    height = max(highest + GRIP_M + carried_m, place[2]) + CLEAR_M
    up = hand[2] < height - OVER_IT_M and np.hypot(*(place - hand)[:2]) > CLEAR_M
    return np.array([*(hand if up else place)[:2], height])


def _command(task: ReachTask, place: Float64, on: bool) -> Float64:
    return np.append(pointing_down(task, place), 1.0 if on else -1.0)


def _holds(task: ReachTask) -> bool:
    return bool(task.simulation.hand_pose[-1])


def _tower(design: Design, episode: Episode, rng: np.random.Generator) -> Episode:
    """Every block is to be on the one before."""
    goal = _in_order(rng.permutation(_bodies(design, episode)).tolist(), episode)
    return replace(episode, goal=parse_goal(goal, design.vocabulary))


def _rebuild(design: Design, episode: Episode, rng: np.random.Generator) -> Episode:
    """A tower is to be taken down, a block on each place, and built in another order."""
    blocks, order = list(episode.blocks), rng.permutation(_bodies(design, episode)).tolist()
    for low, top in pairwise(order):
        blocks[top] = _over(blocks[top], blocks[low])
    places = [one.kind for one in blocks if not design.schema.has_body(one.kind)]
    aside = [_on(blocks[i].kind, place) for i, place in zip(order[:0:-1], places, strict=False)]
    other = _in_order([*order[1:], order[0]], episode)
    goal = parse_goal(f"THEN({', '.join([*aside, other])})", design.vocabulary)
    return replace(episode, blocks=tuple(blocks), goal=goal)


def _sort(design: Design, episode: Episode, rng: np.random.Generator) -> Episode:
    """Some block of each color is to be on the place of that color."""
    colors = {episode.blocks[i].kind["color"] for i in _bodies(design, episode)}
    places = [one.kind for one in episode.blocks if not design.schema.has_body(one.kind)]
    parts = [f"{ON}({p['color']}, {p.conjunction})" for p in places if p["color"] in colors]
    goal = f"ALL({', '.join(parts)})" if len(parts) > 1 else parts[0]
    return replace(episode, goal=parse_goal(goal, design.vocabulary))


SEVERAL = {"tower": _tower, "rebuild": _rebuild, "sort": _sort}
"""Goals of several programs, by the first part of a condition's name."""


def _in_order(order: Sequence[int], episode: Episode) -> str:
    kinds = [episode.blocks[i].kind for i in order]
    return f"ALL({', '.join(_on(top, low) for low, top in pairwise(kinds))})"


def _on(moved: Kind, target: Kind) -> str:
    return f"{ON}({moved.conjunction}, {target.conjunction})"


def _bodies(design: Design, episode: Episode) -> list[int]:
    """Which objects of an episode are no places."""
    return [i for i, one in enumerate(episode.blocks) if design.schema.has_body(one.kind)]


def _with_a_part_done(
    config: ArenaConfig, design: Design, episode: Episode, rng: np.random.Generator
) -> Episode:
    """An easier start: the hand over the block that is moved, or holding it; or it is where it is
    to be. At times the target is on top of another block."""
    words = [block.kind.words for block in episode.blocks]
    sets = roles(episode.program, words, None, design.vocabulary.bodiless)
    blocks = list(episode.blocks)
    bodies = _bodies(design, episode)
    target = int(np.flatnonzero(sets[1])[0])
    moved = int(np.flatnonzero(sets[0])[0]) if any(sets[0]) else target
    free = [i for i in bodies if i not in (moved, target) and words[i].isdisjoint(ROUND)]
    if moved != target and free and rng.random() < (RAISED if target in bodies else PLACE_ON_BLOCK):
        blocks[target] = _over(blocks[target], blocks[free[int(rng.integers(len(free)))]])
    how, start, held = rng.random(), episode.arm_start, None
    if how < OVER_BLOCK:
        block = blocks[moved]
        x, y = rng.uniform(-OVER_M, OVER_M, 2) + (block.x, block.y)
        start = joints_at(config, float(x), float(y), float(rng.uniform(*OVER_HEIGHT_M)))
    elif how < OVER_BLOCK + HOLDING:
        ((x, y),) = spots_for(config, 1, rng)
        start, held = joints_at(config, x, y, float(rng.uniform(*CARRIED_HEIGHT_M))), moved
    elif how < OVER_BLOCK + HOLDING + STACKED and moved != target:
        blocks[moved] = _over(blocks[moved], blocks[target])
    return replace(episode, blocks=tuple(blocks), arm_start=start, held=held)


def _over(block: Block, other: Block) -> Block:
    """A block, or a place, on top of another object."""
    return replace(block, x=other.x, y=other.y, above_m=block.above_m + other.above_m + BLOCK_M)
