"""An arena's description for its agents (ArenaInfo); a robot in its place sends the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from math import inf
from typing import Any
from uuid import uuid4

import numpy as np

from msgs_schema import msg
from pa_ros.core.clock import now_ns
from pa_ros.core.experience import ENDLESS
from pa_ros.language import Program, parse
from pa_ros.wire import WireError
from pa_ros.wire.fields import SharedFields, float64_field, read_stamp, write_stamp
from pa_ros.world import Sparse
from pa_ros.world.relation import RELATIONS, programs_in
from pa_ros.world.world import World

# Edition of msgs_schema. Raise it when a receiver of one edition could misread the other.
WIRE_VERSION = "6"
SPARSE = Sparse().to_json()  # the paper's reward


class Mode(IntEnum):
    """The trigger of a control step: a command, or the clock."""

    LOCKSTEP = msg.ArenaInfo.MODE_LOCKSTEP
    REAL_TIME = msg.ArenaInfo.MODE_REAL_TIME


@dataclass(frozen=True, slots=True)
class ArenaDescription:
    """An arena's description; ArenaInfo.msg explains the fields."""

    mode: Mode
    design: str
    arm: str
    preset: str
    seed: int
    block_count: int  # places included
    world: World
    training_programs: tuple[Program, ...]
    joint_names: tuple[str, ...]
    joint_lower: tuple[float, ...]  # rad
    joint_upper: tuple[float, ...]  # rad
    speed_limits: tuple[float, ...]  # rad/s
    control_period: float  # s
    thresholds: tuple[float, ...]  # of the world's relations, in their units
    episode_steps: int
    reward: str = SPARSE  # canonical JSON: name and parameters
    perception: str = ""  # calibration of the camera that properties are seen with
    hand_index: int = 0
    stamp_ns: int = 0
    arena_id: str = ""
    software_version: str = ""

    def threshold(self, goal: str, stage: int = 0) -> float | None:
        """Where the relation of a stage of a goal's text begins to hold; None if it is of another
        world."""
        programs = programs_in(goal)
        relation, moves_hand = programs[stage] if stage < len(programs) else ("", True)
        own = dict(zip(self.world.relations, self.thresholds, strict=True)).get(relation)
        if own is None or moves_hand:
            return own
        return RELATIONS[relation].between or own


SAME = SharedFields(ArenaDescription, msg.ArenaInfo)
NUMBERS = SharedFields(ArenaDescription, msg.ArenaInfo, ("tuple[float, ...]",))


def describe_robot(
    world: World,
    speed_limits: Mapping[str, float],
    control_period_s: float,
    design: str = "",
    preset: str = "",
    arm: str = "",
    limits: Sequence[tuple[float, float]] = (),
) -> ArenaDescription:
    """The description that a robot publishes in place of an arena, with a new id.

    :param world: the agent's world; agents of another world reject the robot.
    :param speed_limits: rad/s by joint, reached at action 1; their order is the joints' order.
    :param design: by its name and those of preset and arm, tools draw the table.
    :param limits: lower and upper joint position, rad, one pair per joint; empty: no limits.
    """
    lower, upper = zip(*(limits or [(-inf, inf)] * len(speed_limits)), strict=True)
    return ArenaDescription(
        mode=Mode.REAL_TIME,
        design=design,
        arm=arm,
        preset=preset,
        seed=0,
        block_count=0,
        world=world,
        training_programs=(),
        joint_names=tuple(speed_limits),
        joint_lower=lower,
        joint_upper=upper,
        speed_limits=tuple(speed_limits.values()),
        control_period=control_period_s,
        thresholds=tuple(RELATIONS[name].threshold for name in world.relations),
        episode_steps=ENDLESS,
        stamp_ns=now_ns(),
        arena_id=uuid4().hex[:8],
    )


def encode_arena_info(arena: ArenaDescription) -> msg.ArenaInfo:
    """The latched self-description of an arena."""
    message = msg.ArenaInfo()
    write_stamp(message.stamp, arena.stamp_ns)
    SAME.write(message, arena)
    message.wire_version = WIRE_VERSION
    message.mode = int(arena.mode)
    write_world(message, arena.world)
    message.training_programs = list(map(str, arena.training_programs))
    message.object_feature_names = list(arena.world.schema.feature_names)
    message.joint_names = list(arena.joint_names)
    for name in NUMBERS.names:
        setattr(message, name, float64_field(np.asarray(getattr(arena, name))))
    return message


def decode_arena_info(message: msg.ArenaInfo) -> ArenaDescription:
    """What an arena offers. Raises WireError, ConfigError (no world), ProgramError."""
    check_version("arena_info", message)
    world = read_world("arena_info", message)
    _check(message, world)
    numbers: dict[str, Any] = {name: tuple(getattr(message, name)) for name in NUMBERS.names}
    return ArenaDescription(
        mode=Mode(message.mode),
        world=world,
        training_programs=read_programs(message, world),
        joint_names=tuple(message.joint_names),
        stamp_ns=read_stamp(message.stamp),
        **numbers,
        **SAME.read(message),
    )


def _check(message: msg.ArenaInfo, world: World) -> None:
    if message.mode not in tuple(Mode):
        modes = [int(mode) for mode in Mode]
        raise WireError("arena_info.mode", modes, message.mode, code="wire.range")
    joints = tuple(message.joint_names)
    if not len(joints) == len(set(joints)) == world.joints:
        expected = f"{world.joints} different names"
        raise WireError("arena_info.joint_names", expected, joints, code="wire.joint_names")
    sizes = dict.fromkeys(("joint_lower", "joint_upper", "speed_limits"), world.joints)
    for field, size in (sizes | {"thresholds": len(world.relations)}).items():
        received = len(getattr(message, field))
        if received != size:
            raise WireError(f"arena_info.{field}", size, received, code="wire.size")
    limits = list(zip(message.joint_lower, message.joint_upper, strict=True))
    if not all(low < high for low, high in limits):
        field = "arena_info.joint_lower"
        raise WireError(field, "less than joint_upper", limits, code="wire.range")
    check_positive(
        "arena_info",
        speed_limits=message.speed_limits,
        control_period=(message.control_period,),
        thresholds=message.thresholds,
        episode_steps=(message.episode_steps,),
    )


# Shared with other announcements (LearnerInfo, Provenance).


def check_version(where: str, message: Any) -> None:
    """Raise WireError (`wire.version`) for a message of another edition of msgs_schema."""
    received = message.wire_version
    if received != WIRE_VERSION:
        raise WireError(f"{where}.wire_version", WIRE_VERSION, received, code="wire.version")


def check_positive(where: str, **fields: Sequence[float]) -> None:
    """Raise WireError (`wire.range`) unless all numbers are finite and greater than 0."""
    for field, values in fields.items():
        for value in values:
            if not 0.0 < value < inf:
                raise WireError(f"{where}.{field}", "a positive number", value, code="wire.range")


def write_world(message: Any, world: World) -> None:
    """Set the world as JSON, and its digest."""
    message.world, message.world_digest = world.to_json(), world.digest


def read_world(where: str, message: Any) -> World:
    """The world of a message. Raises ConfigError, WireError (`wire.world`)."""
    world = World.from_json(message.world)
    if world.digest != message.world_digest:
        field = f"{where}.world_digest"
        raise WireError(field, world.digest, message.world_digest, code="wire.world")
    return world


def read_programs(message: Any, world: World) -> tuple[Program, ...]:
    """The training programs, parsed with the world's words. Raises ProgramError."""
    return tuple(parse(text, world.vocabulary) for text in message.training_programs)
