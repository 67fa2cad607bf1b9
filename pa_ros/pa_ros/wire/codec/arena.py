"""What an arena offers (ArenaInfo)."""

from __future__ import annotations

import numpy as np

from pa_ros.wire import errors
from pa_ros.wire.arrays import float64_field
from pa_ros.wire.codec.program import read_programs
from pa_ros.wire.codec.stamp import read_stamp, write_stamp
from pa_ros.wire.codec.world import read_world, write_world
from pa_ros.wire.interfaces import ArenaInfo
from pa_ros.wire.records import WIRE_VERSION, ArenaDescription, Mode
from pa_ros.world.world import World


def encode_arena_info(arena: ArenaDescription) -> ArenaInfo:
    """The latched self-description of an arena."""
    message = ArenaInfo()
    write_stamp(message.stamp, arena.stamp_ns)
    message.arena_id = arena.arena_id
    message.software_version = arena.software_version
    message.wire_version = WIRE_VERSION
    message.mode = int(arena.mode)
    message.design = arena.design
    message.arm = arena.arm
    message.preset = arena.preset
    message.seed = arena.seed
    message.block_count = arena.block_count
    write_world(message, arena.world)
    message.training_programs = list(map(str, arena.training_programs))
    message.object_feature_names = list(arena.world.schema.feature_names)
    message.hand_index = arena.hand_index
    message.joint_names = list(arena.joint_names)
    message.joint_lower = float64_field(np.asarray(arena.joint_lower))
    message.joint_upper = float64_field(np.asarray(arena.joint_upper))
    message.speed_limits = float64_field(np.asarray(arena.speed_limits))
    message.control_period = arena.control_period
    message.thresholds = float64_field(np.asarray(arena.thresholds))
    message.episode_steps = arena.episode_steps
    message.reward = arena.reward
    return message


def decode_arena_info(message: ArenaInfo) -> ArenaDescription:
    """Raises VersionError, ConfigError, WorldError, FeatureNamesError, RangeError, SizeError,
    JointNamesError."""
    if message.wire_version != WIRE_VERSION:
        raise errors.VersionError("arena_info.wire_version", WIRE_VERSION, message.wire_version)
    world = read_world("arena_info", message)
    _check(message, world)
    return ArenaDescription(
        mode=Mode(message.mode),
        design=message.design,
        arm=message.arm,
        preset=message.preset,
        seed=message.seed,
        block_count=message.block_count,
        world=world,
        training_programs=read_programs(message, world),
        joint_names=tuple(message.joint_names),
        joint_lower=tuple(message.joint_lower),
        joint_upper=tuple(message.joint_upper),
        speed_limits=tuple(message.speed_limits),
        control_period=message.control_period,
        thresholds=tuple(message.thresholds),
        episode_steps=message.episode_steps,
        reward=message.reward,
        hand_index=message.hand_index,
        stamp_ns=read_stamp(message.stamp),
        arena_id=message.arena_id,
        software_version=message.software_version,
    )


def _check(message: ArenaInfo, world: World) -> None:
    names, field = tuple(message.object_feature_names), "arena_info.object_feature_names"
    if names != world.schema.feature_names:
        raise errors.FeatureNamesError(field, world.schema.feature_names, names)
    if message.mode not in tuple(Mode):
        raise errors.RangeError("arena_info.mode", [int(mode) for mode in Mode], message.mode)
    joints = tuple(message.joint_names)
    if not len(joints) == len(set(joints)) == world.joints:
        expected = f"{world.joints} different names"
        raise errors.JointNamesError("arena_info.joint_names", expected, joints)
    _check_numbers(message, world)


def _check_numbers(message: ArenaInfo, world: World) -> None:
    sizes = dict.fromkeys(("joint_lower", "joint_upper", "speed_limits"), world.joints)
    for field, expected in (sizes | {"thresholds": len(world.relations)}).items():
        size = len(getattr(message, field))
        if size != expected:
            raise errors.SizeError(f"arena_info.{field}", expected, size)
    if not all(
        low < high for low, high in zip(message.joint_lower, message.joint_upper, strict=True)
    ):
        limits = (list(message.joint_lower), list(message.joint_upper))
        raise errors.RangeError("arena_info.joint_lower", "less than joint_upper", limits)
    positive = {
        "speed_limits": message.speed_limits,
        "control_period": (message.control_period,),
        "thresholds": message.thresholds,
        "episode_steps": (message.episode_steps,),
    }
    for field, values in positive.items():
        for value in values:
            if not 0.0 < value < float("inf"):
                raise errors.RangeError(f"arena_info.{field}", "a positive number", value)
