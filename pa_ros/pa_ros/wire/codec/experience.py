"""Trajectories of experience (Trajectory)."""

from __future__ import annotations

import numpy as np

from pa_ros.core.experience import TrajectoryKey
from pa_ros.language import parse
from pa_ros.wire import errors
from pa_ros.wire import interfaces as types
from pa_ros.wire.arrays import float32_field, read_float32
from pa_ros.wire.codec.stamp import read_stamp, write_stamp
from pa_ros.wire.codec.step import objects_and_hand
from pa_ros.world import Trajectory
from pa_ros.world.world import World

MAX_TRANSITIONS = 10_000


def encode_trajectory(trajectory: Trajectory) -> types.Trajectory:
    """A trajectory."""
    message = types.Trajectory()
    write_stamp(message.stamp, trajectory.stamp_ns)
    message.agent_id, message.incarnation = trajectory.agent_id, trajectory.incarnation
    message.sequence, message.held_from = trajectory.sequence, trajectory.held_from
    message.run_id = trajectory.run_id
    message.policy_version = trajectory.policy_version
    message.episode = trajectory.episode
    message.first_step = trajectory.first_step
    message.program = str(trajectory.program)
    message.world_digest = trajectory.world_digest
    message.hand_index = trajectory.hand_index
    message.transition_count = len(trajectory)
    message.object_count = trajectory.objects.shape[1]
    message.objects = float32_field(trajectory.objects)
    message.arm = float32_field(trajectory.arm)
    message.actions = float32_field(trajectory.actions)
    message.rewards = float32_field(trajectory.rewards)
    message.ends_episode = trajectory.ends_episode
    message.terminated = trajectory.terminated
    return message


def decode_trajectory_key(message: types.Trajectory) -> TrajectoryKey:
    """The name alone, of a trajectory that is decoded later, or not at all."""
    return TrajectoryKey(message.agent_id, message.incarnation, message.sequence)


def decode_trajectory(message: types.Trajectory, world: World) -> Trajectory:
    """A trajectory, refused unless it is of the receiver's world.

    Raises WorldError, ProgramError, RangeError, SizeError, NonFiniteError.
    """
    if message.world_digest != world.digest:
        field, received = "trajectory.world_digest", message.world_digest
        raise errors.WorldError(field, world.digest, received)
    if not message.agent_id:
        raise errors.RangeError("trajectory.agent_id", "a name", repr(message.agent_id))
    if message.held_from > message.sequence:
        expected = f"at most its sequence, {message.sequence}"
        raise errors.RangeError("trajectory.held_from", expected, message.held_from)
    length = message.transition_count
    if not 1 <= length <= MAX_TRANSITIONS:
        raise errors.RangeError("trajectory.transition_count", f"1 to {MAX_TRANSITIONS}", length)
    count, hand_index = objects_and_hand("trajectory", message)
    actions = read_float32("trajectory.actions", message.actions, (length, world.actions))
    if np.abs(actions).max() > 1.0:
        raise errors.RangeError("trajectory.actions", "[-1, 1]", np.abs(actions).max())
    rows = length + 1
    objects = (rows, count, world.object_features)
    return Trajectory(
        agent_id=message.agent_id,
        sequence=message.sequence,
        policy_version=message.policy_version,
        episode=message.episode,
        first_step=message.first_step,
        program=parse(message.program, world.vocabulary),
        hand_index=hand_index,
        objects=read_float32("trajectory.objects", message.objects, objects),
        arm=read_float32("trajectory.arm", message.arm, (rows, world.arm_features)),
        actions=actions,
        rewards=read_float32("trajectory.rewards", message.rewards, (length,)),
        ends_episode=message.ends_episode,
        terminated=message.terminated,
        world_digest=message.world_digest,
        run_id=message.run_id,
        incarnation=message.incarnation,
        held_from=message.held_from,
        stamp_ns=read_stamp(message.stamp),
    )
