"""Episodes: the whole start of one, drawn from a seed and an index."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, sin

import numpy as np

from pa_ros.arena.appearance import Look, look_of, with_edge
from pa_ros.arena.arms import ARMS
from pa_ros.arena.conditions import Condition
from pa_ros.arena.config import ArenaConfig, Joints
from pa_ros.arena.designs import Design, Kind
from pa_ros.arena.errors import ArenaError
from pa_ros.core.experience import Float32
from pa_ros.core.extensions import guarded
from pa_ros.language import Goal, Program, stages
from pa_ros.language.syntax import SIZE
from pa_ros.world.schema import MIDDLE_EDGE_M, ObjectSchema

RANDOM_STREAM = 0  # docs/DESIGN.md: streams of random numbers
PLACEMENT_TRIES = 1000

Spot = tuple[float, float]
"""A place on the table, m from the base axis."""


@dataclass(frozen=True, slots=True)
class Block:
    """A block at the start of an episode: lying on the table, turned about the vertical axis."""

    kind: Kind
    x: float  # m from the base axis
    y: float
    yaw: float  # rad
    edge_m: float = 0.0  # of a cube of its size; 0: as its kind says
    above_m: float = 0.0  # how much higher it is than if it lay on the table

    @property
    def look(self) -> Look:
        """The look of this object."""
        look = look_of(self.kind)
        if self.edge_m:
            look = with_edge(look, self.edge_m)
        return replace(look, lift_m=-self.above_m) if self.above_m < 0 else look

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
    held: int | None = None  # the block that the gripper holds, in place of where the block says

    @property
    def program(self) -> Program:
        """The program that is pursued first: the goal itself, unless it has several."""
        return stages(self.goal)[0]


def generate(
    config: ArenaConfig, design: Design, condition: Condition, seed: int, index: int
) -> Episode:
    """Draw episode `index` from `default_rng([seed, 0, index])`.

    Blocks are unique in their properties. Raises ArenaError (arena.episode) if they do not fit on
    the table.
    """
    rng = np.random.default_rng([seed, RANDOM_STREAM, index])
    drawn = lambda episode, *_: isinstance(episode, Episode)  # noqa: E731
    draw = guarded(f"skill {design.skill_name}", design.skill.draw, drawn, "an Episode")
    episode: Episode = draw(config, design, condition, index, rng)
    return episode


def spots_for(
    config: ArenaConfig, count: int, rng: np.random.Generator, apart_m: float = 0.0
) -> list[Spot]:
    """Draw spots for blocks uniformly from a sector of a ring around the base, with the least
    separation: the arena's, or `apart_m` if that is more."""
    arm, apart_m = ARMS[config.arm], max(apart_m, config.block_separation_m)
    (low, high), (first, last) = arm.block_radii_m, arm.block_angles
    for _ in range(PLACEMENT_TRIES):
        spots: list[Spot] = []
        # An unlucky first spot can make the rest impossible, so start again after a while.
        for _ in range(20 * count):
            # Squared radii are uniform, so that spots are uniform in area.
            radius, angle = rng.uniform(low**2, high**2) ** 0.5, rng.uniform(first, last)
            x, y = float(radius * cos(angle)), float(radius * sin(angle))
            if all((x - u) ** 2 + (y - v) ** 2 >= apart_m**2 for u, v in spots):
                spots.append((x, y))
            if len(spots) == count:
                return spots
    raise ArenaError(
        f"{count} blocks don't fit on the ring {low} to {high} m, {first:.2f} to {last:.2f} rad, "
        f"at a distance of {apart_m} m",
        code="arena.episode",
    )
