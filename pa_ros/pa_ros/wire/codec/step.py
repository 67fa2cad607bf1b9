"""One control step: observation (object_features and joint_states), verdict, joint command.

What is encoded at every step may be written `into` messages that have been sent: making them
takes longer than filling them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from pa_ros.core.experience import (
    CommandKey,
    Executed,
    Float32,
    Float64,
    Observation,
    Verdict,
)
from pa_ros.wire import errors
from pa_ros.wire.arrays import float32_field, float64_field, read_float32, read_float64
from pa_ros.wire.codec.stamp import header_stamp, write_stamp
from pa_ros.wire.interfaces import Clock, JointCommand, JointState, ObjectFeatures, Trajectory
from pa_ros.wire.interfaces import Verdict as VerdictMessage
from pa_ros.wire.records import Command, StepContext, StepMark

HAND_FRAME = "hand"
MAX_OBJECTS = 64
LARGEST = 1e4  # m, rad, rad/s: far beyond any arena, and far within what networks can add up
NO_CONTEXT = StepContext()
NO_COMMAND = Executed(CommandKey("", 0, 0), np.empty(0, np.float32))


@dataclass
class StepMessages:
    """Of one control step of an arena."""

    features: ObjectFeatures = field(default_factory=ObjectFeatures)
    joints: JointState = field(default_factory=JointState)
    verdict: VerdictMessage = field(default_factory=VerdictMessage)
    clock: Clock = field(default_factory=Clock)


def encode_observation(
    observation: Observation,
    joint_names: tuple[str, ...],
    context: StepContext = NO_CONTEXT,
    into: StepMessages | None = None,
) -> tuple[ObjectFeatures, JointState]:
    """The two messages of one observation; they share one stamp."""
    features = into.features if into else ObjectFeatures()
    joints = into.joints if into else JointState()
    write_stamp(features.header.stamp, observation.stamp_ns)
    features.header.frame_id = HAND_FRAME
    features.episode = observation.episode
    features.step = observation.step
    features.arena_id, features.evaluation = context.arena_id, context.evaluation
    executed = context.executed or NO_COMMAND
    features.commanded_by, features.commanded_incarnation, features.command_id = executed.command
    features.applied = float32_field(executed.action)
    features.program_id, features.program = observation.program_id, context.program
    features.hand_index = observation.hand_index
    features.object_count = len(observation.objects)
    features.features = float32_field(observation.objects)
    features.hand_pose = float64_field(observation.hand_pose)
    write_stamp(joints.header.stamp, observation.stamp_ns)
    joints.header.frame_id = context.arena_id
    joints.name = list(joint_names)
    joints.position = float64_field(observation.joint_position)
    joints.velocity = float64_field(observation.joint_velocity)
    return features, joints


def is_evaluation(message: ObjectFeatures | VerdictMessage) -> bool:
    """Whether the step belongs to an episode that must leave no trace in training."""
    return bool(message.evaluation)


def arena_of(message: ObjectFeatures | JointState | VerdictMessage) -> str:
    """Which arena a part of a step is of."""
    return str(message.header.frame_id if isinstance(message, JointState) else message.arena_id)


def decode_context(message: ObjectFeatures, joints: int | None = None) -> StepContext:
    """What the features say beside the observation, in an arena whose arm has so many joints.
    Raises SizeError, NonFiniteError."""
    executed = decode_executed(message, joints)
    return StepContext(message.arena_id, bool(message.evaluation), executed, message.program)


def decode_executed(message: ObjectFeatures, joints: int | None = None) -> Executed | None:
    """The command that, unaltered, led to this step, for so many joints; None: for however many.
    Raises SizeError, NonFiniteError."""
    if not message.commanded_by:
        return None
    command = CommandKey(message.commanded_by, message.commanded_incarnation, message.command_id)
    shape = (len(message.applied) if joints is None else joints,)
    action = read_float32("object_features.applied", message.applied, shape)
    return Executed(command, action)


def decode_observation(
    features: ObjectFeatures,
    joints: JointState,
    joint_names: tuple[str, ...],
    width: int | None = None,
) -> Observation:
    """One observation from its two messages. Joints may come in any order, and more than ours.

    `width`: features of an object in this world. Raises StampError, SizeError, RangeError,
    NonFiniteError, FeatureNamesError, JointNamesError.
    """
    stamp_ns = header_stamp(features)
    if header_stamp(joints) != stamp_ns:
        raise errors.StampError("joint_states.header.stamp", stamp_ns, header_stamp(joints))
    objects, hand_index = decode_objects(features, width)
    position, velocity = decode_joints(joints, joint_names)
    return Observation(
        episode=features.episode,
        step=features.step,
        stamp_ns=stamp_ns,
        objects=objects,
        joint_position=position,
        joint_velocity=velocity,
        hand_index=hand_index,
        program_id=features.program_id,
        hand_pose=decode_hand_pose(features),
    )


def decode_step_mark(message: ObjectFeatures | VerdictMessage) -> StepMark:
    """Which step a message is of."""
    text = getattr(message, "program", "")  # verdicts have none, nor have older recordings
    evaluation = bool(message.evaluation)
    return StepMark(message.episode, message.step, evaluation, message.program_id, text)


def decode_objects(message: ObjectFeatures, width: int | None = None) -> tuple[Float32, int]:
    """Features of the objects, [N, F], and which is the hand; `width` is F where it is known.

    Raises FeatureNamesError (another width), SizeError, RangeError, NonFiniteError.
    """
    count, hand_index = objects_and_hand("object_features", message)
    received, rest = divmod(len(message.features), count)
    if width not in (None, received) and not rest:
        expected = f"{width} of each of {count} objects"
        raise errors.FeatureNamesError("object_features.features", expected, received)
    shape = (count, width or received)
    return read_float32("object_features.features", message.features, shape, LARGEST), hand_index


def decode_hand_pose(message: ObjectFeatures) -> Float64:
    """Pose of the hand in the base frame, [7]; NaN in recordings older than it.

    Raises NonFiniteError, RangeError.
    """
    if not hasattr(message, "hand_pose"):
        return np.full(7, np.nan)
    return read_float64("object_features.hand_pose", message.hand_pose, (7,), LARGEST)


def objects_and_hand(where: str, message: ObjectFeatures | Trajectory) -> tuple[int, int]:
    """Checked number of objects and index of the hand. Raises RangeError."""
    count, hand_index = message.object_count, message.hand_index
    if not 1 <= count <= MAX_OBJECTS:
        raise errors.RangeError(f"{where}.object_count", f"1 to {MAX_OBJECTS}", count)
    if hand_index >= count:
        raise errors.RangeError(f"{where}.hand_index", f"less than {count} objects", hand_index)
    return count, hand_index


def decode_joints(joints: JointState, names: tuple[str, ...]) -> tuple[Float64, Float64]:
    """Positions (rad) and velocities (rad/s) of the joints named, in that order; of all as they
    come if none is named. Raises SizeError, NonFiniteError, RangeError, JointNamesError."""
    received = tuple(joints.name)
    if received != names and not set(names) <= set(received):
        raise errors.JointNamesError("joint_states.name", names, received)
    shape = (len(received),)
    position = read_float64("joint_states.position", joints.position, shape, LARGEST)
    velocity = read_float64("joint_states.velocity", joints.velocity, shape, LARGEST)
    if not names or received == names:
        return position, velocity
    order = [received.index(name) for name in names]
    return position[order], velocity[order]


def encode_verdict(
    verdict: Verdict,
    evaluation: bool = False,
    arena_id: str = "",
    into: VerdictMessage | None = None,
) -> VerdictMessage:
    """The verifier's word on one step."""
    message = into or VerdictMessage()
    write_stamp(message.header.stamp, verdict.stamp_ns)
    message.arena_id = arena_id
    message.episode = verdict.episode
    message.step = verdict.step
    message.evaluation = evaluation
    message.program_id = verdict.program_id
    message.reward = verdict.reward
    message.satisfied = verdict.satisfied
    message.distance = verdict.distance
    message.truncated = verdict.truncated
    return message


def decode_verdict(message: VerdictMessage) -> Verdict:
    """Raises NonFiniteError (reward), RangeError (a distance that is NaN or negative)."""
    if not math.isfinite(message.reward):
        raise errors.NonFiniteError("verdict.reward", "a finite number", message.reward)
    if not message.distance >= 0.0:
        raise errors.RangeError("verdict.distance", "at least 0 m, or inf", message.distance)
    return Verdict(
        episode=message.episode,
        step=message.step,
        stamp_ns=header_stamp(message),
        program_id=message.program_id,
        reward=message.reward,
        satisfied=message.satisfied,
        distance=message.distance,
        truncated=message.truncated,
    )


def encode_command(command: Command, into: JointCommand | None = None) -> JointCommand:
    """An agent's answer to one observation."""
    message = into or JointCommand()
    write_stamp(message.header.stamp, command.stamp_ns)
    message.episode = command.episode
    message.step = command.step
    message.agent_id, message.incarnation = command.agent_id, command.incarnation
    message.command_id = command.number
    message.policy_version = command.policy_version
    message.action = float32_field(command.action)
    return message


def decode_command(message: JointCommand, joints: int | None = None) -> Command:
    """A command for an arm of so many joints; None: of however many. Clamping to [-1, 1] is the
    arm's affair. Raises SizeError, NonFiniteError."""
    shape = (len(message.action) if joints is None else joints,)
    return Command(
        episode=message.episode,
        step=message.step,
        stamp_ns=header_stamp(message),
        agent_id=message.agent_id,
        policy_version=message.policy_version,
        action=read_float32("joint_commands.action", message.action, shape),
        incarnation=message.incarnation,
        number=message.command_id,
    )
