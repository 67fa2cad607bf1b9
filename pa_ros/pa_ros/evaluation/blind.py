"""References that know where all blocks are and how to reach them, but ignore the program.

An agent that does not score above the best of these has shown no understanding of a program.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain, combinations

import numpy as np

from pa_ros.arena import ARMS, ReachTask
from pa_ros.arena.pushing import Pushing
from pa_ros.arena.references import pursue, push
from pa_ros.arena.simulation import HAND_INDEX
from pa_ros.core.experience import Float64, Observation
from pa_ros.world.relation import RELATIONS

BLIND = ("nearest", "any", "most")
"""Go to the block nearest to the hand; to a random one; to the place near most blocks.

Where a block is to be moved: a block to a place, the nearest two; a random block to another object;
the block nearest to the hand, to the place nearest to it.
"""

BLIND_STREAM = 5  # of random numbers, beside those of docs/DESIGN.md
MARGIN = 0.95  # of the horizontal reach: the hand does not stop exactly where it should


def blind_policy(task: ReachTask, name: str) -> Callable[[Observation], Float64]:
    """One of BLIND as commands for the arm. It chooses at the start of an episode."""
    choose = {"nearest": _nearest, "any": _any, "most": _most}[name]
    goal, pair = np.zeros(3), (0, 0)

    def act(observation: Observation) -> Float64:
        nonlocal goal, pair
        if HAND_INDEX not in task.verifier.moved:
            pair = _pair(task, name) if observation.step == 0 else pair
            skill = task.design.skill
            own = skill.relate if isinstance(skill, Pushing) else push
            return own(task, *pair)
        if observation.step == 0:
            goal = choose(task)
        return pursue(task, goal)

    return act


def _pair(task: ReachTask, name: str) -> tuple[int, int]:
    """A block to move, and the object to move it to."""
    positions, schema = task.simulation.positions, task.design.schema
    bodies = [schema.has_body(block.kind) for block in task.episode.blocks]
    blocks = [i for i, solid in enumerate(bodies, start=1) if solid]
    places = [i for i, solid in enumerate(bodies, start=1) if not solid]
    if name == "any":
        rng = np.random.default_rng([task.seed, BLIND_STREAM, task.episode.index])
        moved = blocks[int(rng.integers(len(blocks)))]
        others = [i for i in (*blocks, *places) if i != moved]
        return moved, others[int(rng.integers(len(others)))]

    def apart(i: int, j: int) -> float:
        return float(np.linalg.norm(positions[i] - positions[j]))

    if name == "most":
        blocks = [min(blocks, key=lambda i: apart(0, i))]
    pairs = [(i, j) for i in blocks for j in places or [k for k in blocks if k != i]]
    return min(pairs, key=lambda pair: apart(*pair))


def _nearest(task: ReachTask) -> Float64:
    hand, blocks = _places(task)
    return _nearest_of(list(blocks), hand)


def _any(task: ReachTask) -> Float64:
    _, blocks = _places(task)
    rng = np.random.default_rng([task.seed, BLIND_STREAM, task.episode.index])
    return np.asarray(blocks[int(rng.integers(len(blocks)))])


def _most(task: ReachTask) -> Float64:
    """The block, or the middle of two or three blocks, at which the program's relation holds for
    most blocks."""
    hand, blocks = _places(task)
    groups = chain(combinations(blocks, 2), combinations(blocks, 3))
    middles = [np.mean(group, axis=0) for group in groups]
    middles = [*blocks, *(middle for middle in middles if _in_reach(task, middle))]
    counts = [_held(task, hand, blocks, middle) for middle in middles]
    return _nearest_of([m for m, n in zip(middles, counts, strict=True) if n == max(counts)], hand)


def _held(task: ReachTask, hand: Float64, blocks: Float64, middle: Float64) -> int:
    """For how many blocks the relation holds when the hand goes for `middle`, with the margin."""
    relation = RELATIONS[task.program.relation]
    threshold = task.scoring.threshold(relation.name)
    farther = np.full_like(blocks, middle)
    farther[:, :2] += (blocks - middle)[:, :2] / MARGIN
    goal = relation.goal(hand, middle, threshold)
    return int((relation.of_places(goal, farther) <= threshold).sum())


def _in_reach(task: ReachTask, place: Float64) -> bool:
    """Whether a block may lie there; the arm reaches those places, but none near its base."""
    low, high = ARMS[task.config.arm].block_radii_m
    return low <= float(np.hypot(*place[:2])) <= high


def _places(task: ReachTask) -> tuple[Float64, Float64]:
    """Hand [3] and blocks [N - 1, 3], m, table frame."""
    positions = task.simulation.positions
    return positions[0], positions[1:]


def _nearest_of(points: list[Float64], hand: Float64) -> Float64:
    return min(points, key=lambda point: float(np.linalg.norm(point - hand)))
