"""What a robot says of itself in place of a simulated arena."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from math import inf
from types import MappingProxyType
from uuid import uuid4

from pa_ros.wire.records import ArenaDescription, Mode
from pa_ros.world.relations import RELATIONS
from pa_ros.world.world import World

ENDLESS = 2**31 - 1  # steps


def describe_robot(
    world: World,
    speed_limits: Mapping[str, float],
    control_period_s: float,
    arm: str = "",
    thresholds: Mapping[str, float] = MappingProxyType({}),
    limits: Sequence[tuple[float, float]] = (),
) -> ArenaDescription:
    """The description that `codec.encode_arena_info` sends, with the world's digest.

    `world` is the agent's: an agent of another one, of other words say, refuses the robot.
    `speed_limits`, rad/s by joint, say what an action of 1 is and which order joints have;
    `thresholds` of relations, by name, say when they hold, if not at their own; `limits` are the
    joints' positions', rad, if there are any. The id is another at each start.
    """
    lower, upper = zip(*(limits or [(-inf, inf)] * len(speed_limits)), strict=True)
    return ArenaDescription(
        mode=Mode.REAL_TIME,
        design="robot",
        arm=arm,
        preset="robot",
        seed=0,
        block_count=0,
        world=world,
        training_programs=(),
        joint_names=tuple(speed_limits),
        joint_lower=lower,
        joint_upper=upper,
        speed_limits=tuple(speed_limits.values()),
        control_period=control_period_s,
        thresholds=tuple(
            thresholds.get(name, RELATIONS[name].threshold) for name in world.relations
        ),
        episode_steps=ENDLESS,
        stamp_ns=time.time_ns(),
        arena_id=uuid4().hex[:8],
    )
