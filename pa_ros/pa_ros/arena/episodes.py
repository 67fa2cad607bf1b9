"""Episodes: the whole start of one, drawn from a seed and an index."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np

from pa_ros.arena.arms import ARMS
from pa_ros.arena.conditions import Condition, program_for
from pa_ros.arena.config import ArenaConfig, Joints
from pa_ros.arena.designs import Design, Kind
from pa_ros.arena.errors import ArenaError
from pa_ros.language import Program, satisfying

RANDOM_STREAM = 0  # docs/DESIGN.md: streams of random numbers
PLACEMENT_TRIES = 1000


@dataclass(frozen=True, slots=True)
class Block:
    """A block at the start of an episode: lying on the table, turned about the vertical axis."""

    kind: Kind
    x: float  # m from the base axis
    y: float
    yaw: float  # rad


@dataclass(frozen=True, slots=True)
class Episode:
    """The start of an episode. Equal episodes evolve equally under equal commands."""

    index: int
    condition: str
    blocks: tuple[Block, ...]
    arm_start: Joints  # rad
    program: Program


def generate(
    config: ArenaConfig, design: Design, condition: Condition, seed: int, index: int
) -> Episode:
    """Draw episode `index` from `default_rng([seed, 0, index])`.

    Blocks are unique in their properties, in random order, and the program names exactly one.
    There are fewer than `condition.n_blocks` if the design has too few kinds that the program
    does not name. Raises ArenaError (arena.episode) if the blocks do not fit on the table.
    """
    rng = np.random.default_rng([seed, RANDOM_STREAM, index])
    # The order of the draws must not change, because every published result depends on it.
    base = float(rng.uniform(config.joint_lower[0], config.joint_upper[0]))
    target = condition.targets[int(rng.integers(len(condition.targets)))]
    program, required = program_for(condition, design, target, rng)
    named = satisfying(program, [kind.words for kind in condition.pool], None)
    unnamed = [kind for kind, is_named in zip(condition.pool, named, strict=True) if not is_named]
    chosen = [target, *required, *_distractors(condition, design, unnamed, list(required), rng)]
    order = rng.permutation(len(chosen))
    blocks = tuple(
        Block(chosen[i], x, y, float(rng.uniform(-pi, pi)))
        for i, (x, y) in zip(order, _places(config, len(chosen), rng), strict=True)
    )
    start = base, *(joint.start for joint in ARMS[config.arm].joints[1:])
    return Episode(index, condition.name, blocks, start, program)


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


def _places(config: ArenaConfig, count: int, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Draw places uniformly from a sector of a ring around the base, with the least separation."""
    arm = ARMS[config.arm]
    (low, high), (first, last) = arm.block_radii_m, arm.block_angles
    for _ in range(PLACEMENT_TRIES):
        places: list[tuple[float, float]] = []
        # An unlucky first place can make the rest impossible, so start again after a while.
        for _ in range(20 * count):
            # Squared radii are uniform, so that places are uniform in area.
            radius, angle = rng.uniform(low**2, high**2) ** 0.5, rng.uniform(first, last)
            x, y = float(radius * cos(angle)), float(radius * sin(angle))
            if all((x - u) ** 2 + (y - v) ** 2 >= config.block_separation_m**2 for u, v in places):
                places.append((x, y))
            if len(places) == count:
                return places
    raise ArenaError(
        f"{count} blocks don't fit on the ring {low} to {high} m, {first:.2f} to {last:.2f} rad, "
        f"at a distance of {config.block_separation_m} m",
        code="arena.episode",
    )
