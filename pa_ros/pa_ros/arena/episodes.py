"""Episodes: the whole start of one, drawn from a seed and an index."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from math import atan2, cos, hypot, pi, sin

import numpy as np
from numpy.typing import NDArray

from pa_ros.arena.appearance import Look, look_of, with_edge
from pa_ros.arena.arms import ARMS
from pa_ros.arena.conditions import (
    Condition,
    avoiding,
    chain_for,
    formula_for,
    moving_program,
    program_for,
)
from pa_ros.arena.config import ArenaConfig, Joints
from pa_ros.arena.controllers import joints_at
from pa_ros.arena.designs import Design, Kind
from pa_ros.arena.errors import ArenaError
from pa_ros.arena.formulas import ZONES_APART_M
from pa_ros.core.experience import Float32
from pa_ros.language import Goal, Program, roles, satisfying, stages
from pa_ros.language.syntax import SIZE
from pa_ros.world.relation import RELATIONS
from pa_ros.world.schema import MIDDLE_EDGE_M, ObjectSchema

RANDOM_STREAM = 0  # docs/DESIGN.md: streams of random numbers
PLACEMENT_TRIES = 1000
AVOID_WITHIN_M = 0.30  # from the target to what is to be avoided, so that it is in the way


@dataclass(frozen=True, slots=True)
class Block:
    """A block at the start of an episode: lying on the table, turned about the vertical axis."""

    kind: Kind
    x: float  # m from the base axis
    y: float
    yaw: float  # rad
    edge_m: float = 0.0  # of a cube of its size; 0: as its kind says

    @property
    def look(self) -> Look:
        """The look of this object."""
        return with_edge(look_of(self.kind), self.edge_m) if self.edge_m else look_of(self.kind)

    def features(self, schema: ObjectSchema) -> Float32:
        """Its features, the pose zero: [F]."""
        row = schema.features(self.kind)
        if self.edge_m:
            row[schema.slices[SIZE]] = self.edge_m - MIDDLE_EDGE_M
        return row


@dataclass(frozen=True, slots=True)
class Episode:
    """The start of an episode. Equal episodes evolve equally under equal commands."""

    index: int
    condition: str
    blocks: tuple[Block, ...]
    arm_start: Joints  # rad
    goal: Goal

    @property
    def program(self) -> Program:
        """The program that is pursued first: the goal itself, unless it has several."""
        return stages(self.goal)[0]


def generate(
    config: ArenaConfig, design: Design, condition: Condition, seed: int, index: int
) -> Episode:
    """Draw episode `index` from `default_rng([seed, 0, index])`.

    Blocks are unique in their properties, in random order, and the program names exactly one, or
    `condition.named`.
    There are fewer than `condition.n_blocks` if the design has too few kinds that the program
    does not name. Raises ArenaError (arena.episode) if the blocks do not fit on the table.
    """
    rng = np.random.default_rng([seed, RANDOM_STREAM, index])
    if design.vocabulary.moves_objects:
        return _moving_episode(config, design, condition, index, rng)
    # The order of the draws must not change, because every published result depends on it.
    base = float(rng.uniform(config.joint_lower[0], config.joint_upper[0]))
    program: Goal
    avoided: list[Kind] = []
    if condition.chain:
        program, (target, *required) = chain_for(condition, design, rng)
    elif condition.formula:
        program, (target, *required) = formula_for(condition, design, rng)
    else:
        target = condition.targets[int(rng.integers(len(condition.targets)))]
        program, needed = program_for(condition, design, target, rng)
        required = list(needed)
        if condition.avoided:
            program, avoided = avoiding(condition, design, program, target, rng)
            required = [*dict.fromkeys((*required, *avoided))]
    words = [kind.words for kind in condition.pool]
    named = np.any([satisfying(one, words, None) for one in stages(program)], axis=0)
    unnamed = [kind for kind, is_named in zip(condition.pool, named, strict=True) if not is_named]
    chosen = [target, *required, *_distractors(condition, design, unnamed, required, rng)]
    order = rng.permutation(len(chosen))
    if condition.formula:
        spots = _places(config, len(order), rng, ZONES_APART_M)
    else:
        spots = _close_places(config, order, bool(avoided), rng)
    blocks = tuple(
        Block(chosen[i], x, y, float(rng.uniform(-pi, pi)))
        for i, (x, y) in zip(order, spots, strict=True)
    )
    if edges := condition.edges_m or design.edges_m:
        drawn = [float(rng.uniform(*edges[block.kind[SIZE]])) for block in blocks]
        blocks = tuple(replace(b, edge_m=m) for b, m in zip(blocks, drawn, strict=True))
    start = base, *(joint.start for joint in ARMS[config.arm].joints[1:])
    return Episode(index, condition.name, blocks, start, program)


# Episodes in which blocks are to be moved. Lengths in m.

MOVE_M = (0.12, 0.40)  # from the block to the place that it is to be moved to
MOVE_TO_BLOCK_M = (0.20, 0.45)  # to another block
PAIRS = 4  # least number of pairs of objects that are so far apart
NEAR_HAND_M = (0.11, 0.22)  # from the moved block to the hand, if it starts beside it
NEAR_HAND_HEIGHT_M = 0.085  # low enough to push
HAND_GAP_M = 0.10  # between the hand and every block
PLACE_GAP_M = 0.12  # between a place and every block, so that no block is near it at the start
PLACES_APART_M = 0.16
SPOT_TRIES = 200

Spot = tuple[float, float]


def _moving_episode(
    config: ArenaConfig,
    design: Design,
    condition: Condition,
    index: int,
    rng: np.random.Generator,
) -> Episode:
    """Draw an episode of a design whose programs move blocks. Blocks come first, then places."""
    base = float(rng.uniform(config.joint_lower[0], config.joint_upper[0]))
    moved = _one_of(condition.moved, rng) if condition.moved else None
    target = _one_of([kind for kind in condition.targets if condition.tells(kind, moved)], rng)
    program, required = moving_program(condition, design, moved, target, rng)
    named = [*([] if moved is None else [moved]), target, *required]
    blocks = list(dict.fromkeys(kind for kind in named if design.schema.has_body(kind)))
    places = list(dict.fromkeys(kind for kind in named if not design.schema.has_body(kind)))
    for chosen, pool, count in (
        (blocks, condition.pool, condition.n_blocks),
        (places, design.places, design.n_places),
    ):
        words = [kind.words for kind in pool]
        taken = satisfying(program, words, None, design.vocabulary.bodiless)
        free = [kind for kind, is_named in zip(pool, taken, strict=True) if not is_named]
        free = [free[i] for i in rng.permutation(len(free)) if free[i] not in chosen]
        chosen.extend(free[: max(count - len(chosen), 0)])
    to_place = target in design.places
    counts = len(blocks), len(places)
    for _ in range(PLACEMENT_TRIES):
        block_spots, place_spots = _layout(config, *counts, moved is not None, to_place, rng)
        spots = [*block_spots, *place_spots]
        if moved is None or not _holds(design, program, [*blocks, *places], spots):
            break
    start = base, *(joint.start for joint in ARMS[config.arm].joints[1:])
    if moved is not None and rng.random() < condition.near_starts:
        spot = _near(config, block_spots[0], NEAR_HAND_M, block_spots, HAND_GAP_M, rng)
        if spot is not None:
            start = joints_at(config, *spot, NEAR_HAND_HEIGHT_M)
    objects = [
        Block(chosen[i], spots[i][0], spots[i][1], float(rng.uniform(-pi, pi)))
        for chosen, spots in ((blocks, block_spots), (places, place_spots))
        for i in rng.permutation(len(chosen))
    ]
    return Episode(index, condition.name, tuple(objects), start, program)


def _one_of(choices: Sequence[Kind], rng: np.random.Generator) -> Kind:
    return choices[int(rng.integers(len(choices)))]


def _holds(design: Design, program: Program, kinds: Sequence[Kind], spots: Sequence[Spot]) -> bool:
    """Whether a program is satisfied by objects that lie at these spots."""
    relation = RELATIONS[program.relation]
    moved, named = roles(program, [kind.words for kind in kinds], None, design.vocabulary.bodiless)
    lying = np.array([(*spot, 0.0) for spot in spots])
    least = relation.between or relation.threshold
    return any(
        relation.of_places(lying[i], lying[j]) <= least
        for i, j in permutations(range(len(kinds)), 2)
        if moved[i] and named[j]
    )


def _layout(
    config: ArenaConfig,
    blocks: int,
    places: int,
    moves_block: bool,
    to_place: bool,
    rng: np.random.Generator,
) -> tuple[list[Spot], list[Spot]]:
    """Spots of blocks and places. The moved block is the first one; its target is the first place,
    or the second block.

    The spots are drawn without the program, and several pairs of them fit it, of which it takes
    any. So the scene says little about which objects the program names.
    """
    low, high = MOVE_M if to_place else MOVE_TO_BLOCK_M
    for _ in range(PLACEMENT_TRIES):
        spots, chosen = _places(config, blocks, rng), list[Spot]()
        while len(chosen) < places:
            spot = _near(config, spots[0], None, spots, PLACE_GAP_M, rng, chosen)
            if spot is None:
                break
            chosen.append(spot)
        if len(chosen) < places:
            continue
        if not moves_block:
            return spots, chosen
        goals = chosen if to_place else spots
        pairs = [
            (i, j)
            for i, spot in enumerate(spots)
            for j, goal in enumerate(goals)
            if low <= _apart(spot, goal) <= high
        ]
        if len(pairs) < min(PAIRS, blocks * len(goals) // 2):
            continue
        i, j = pairs[int(rng.integers(len(pairs)))]
        first, second = spots[i], goals[j]
        rest = [spot for spot in spots if spot not in (first, second)]
        if to_place:
            return [first, *rest], [second, *(spot for spot in chosen if spot != second)]
        return [first, second, *rest], chosen
    raise ArenaError(
        f"{blocks} blocks and {places} places don't fit on the table", code="arena.episode"
    )


def _near(
    config: ArenaConfig,
    spot: Spot,
    distances: tuple[float, float] | None,
    blocks: Sequence[Spot],
    gap: float,
    rng: np.random.Generator,
    places: Sequence[Spot] = (),
) -> Spot | None:
    """A random spot in the arm's reach, whose distance from `spot` is in `distances` (None: any),
    away from blocks and places; None if no try succeeded."""
    arm = ARMS[config.arm]
    (low, high), (first, last) = arm.block_radii_m, arm.block_angles
    for _ in range(SPOT_TRIES):
        if distances is None:
            distance, angle = rng.uniform(low**2, high**2) ** 0.5, rng.uniform(first, last)
            x, y = distance * cos(angle), distance * sin(angle)
        else:
            distance, angle = rng.uniform(*distances), rng.uniform(-pi, pi)
            x, y = spot[0] + distance * cos(angle), spot[1] + distance * sin(angle)
        found = float(x), float(y)
        reached = low <= hypot(x, y) <= high and first <= atan2(y, x) <= last
        free = all(_apart(found, block) >= gap for block in blocks)
        if reached and free and all(_apart(found, place) >= PLACES_APART_M for place in places):
            return found
    return None


def _apart(one: Spot, other: Spot) -> float:
    return hypot(one[0] - other[0], one[1] - other[1])


def _distractors(
    condition: Condition,
    design: Design,
    unnamed: list[Kind],
    required: list[Kind],
    rng: np.random.Generator,
) -> list[Kind]:
    """Draw the other blocks uniformly from the kinds that the program does not name."""
    rest = [kind for kind in unnamed if kind not in required]
    chosen: list[Kind] = []
    count = min(condition.n_blocks - 1 - len(required), len(rest))
    if condition.new_distractor and count > 0:
        new = [kind for kind in rest if kind not in design.pool]
        chosen.append(new[int(rng.integers(len(new)))])
        rest.remove(chosen[0])
    picks = rng.permutation(len(rest))[: max(count - len(chosen), 0)]
    return chosen + [rest[i] for i in picks]


def _close_places(
    config: ArenaConfig, order: NDArray[np.intp], close: bool, rng: np.random.Generator
) -> list[Spot]:
    """Spots for the blocks, in their order. If `close`, the target and the first block to avoid are
    near each other."""
    for _ in range(PLACEMENT_TRIES):
        spots = _places(config, len(order), rng)
        if not close:
            break
        (x, y), (u, v) = (spots[int(np.flatnonzero(order == i)[0])] for i in (0, 1))
        if hypot(x - u, y - v) <= AVOID_WITHIN_M:
            break
    return spots


def _places(
    config: ArenaConfig,
    count: int,
    rng: np.random.Generator,
    apart_m: float = 0.0,
) -> list[Spot]:
    """Draw places uniformly from a sector of a ring around the base, with the least separation: the
    arena's, or `apart_m` if that is more."""
    arm, apart_m = ARMS[config.arm], max(apart_m, config.block_separation_m)
    (low, high), (first, last) = arm.block_radii_m, arm.block_angles
    for _ in range(PLACEMENT_TRIES):
        places: list[Spot] = []
        # An unlucky first place can make the rest impossible, so start again after a while.
        for _ in range(20 * count):
            # Squared radii are uniform, so that places are uniform in area.
            radius, angle = rng.uniform(low**2, high**2) ** 0.5, rng.uniform(first, last)
            x, y = float(radius * cos(angle)), float(radius * sin(angle))
            if all((x - u) ** 2 + (y - v) ** 2 >= apart_m**2 for u, v in places):
                places.append((x, y))
            if len(places) == count:
                return places
    raise ArenaError(
        f"{count} blocks don't fit on the ring {low} to {high} m, {first:.2f} to {last:.2f} rad, "
        f"at a distance of {apart_m} m",
        code="arena.episode",
    )
