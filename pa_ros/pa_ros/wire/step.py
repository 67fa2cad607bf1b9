"""One control step, the command that answers it, and views of it: joint_states, verdict, clock.

Messages sent at every step can be written `into` messages that were published before, because
making a message object takes longer than filling it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from msgs_schema import msg
from pa_ros.core.experience import (
    CommandKey,
    Executed,
    Float32,
    Observation,
    Step,
    Verdict,
)
from pa_ros.wire import WireError
from pa_ros.wire.fields import (
    NS,
    float32_field,
    float64_field,
    read_array,
    read_measures,
    read_stamp,
    write_stamp,
)

HAND_FRAME = "hand"
MAX_OBJECTS = 64
# m, rad, rad/s: far beyond any arena, and small enough that sums in a network stay finite.
LARGEST = 1e4


@dataclass(frozen=True, slots=True)
class Command:
    """An agent's answer to one observation."""

    episode: int
    step: int
    stamp_ns: int  # of the observation answered
    agent_id: str
    policy_version: int
    action: Float32  # [J], share of each joint's speed limit
    incarnation: int = 0  # of the agent
    number: int = 0  # of the command, among the agent's


NO_COMMAND = Executed(CommandKey("", 0, 0), np.empty(0, np.float32))
NOT_JUDGED = Verdict(0.0, False, math.inf, False)


def encode_step(step: Step, into: msg.ObjectFeatures | None = None) -> msg.ObjectFeatures:
    """One control step."""
    message = into or msg.ObjectFeatures()
    observation, executed = step.observation, step.executed or NO_COMMAND
    verdict = step.verdict or NOT_JUDGED
    stamp = message.header.stamp
    stamp.sec, stamp.nanosec = divmod(observation.stamp_ns, NS)
    message.header.frame_id = HAND_FRAME
    message.arena_id, message.evaluation = step.arena_id, step.evaluation
    message.episode, message.step = observation.episode, observation.step
    message.commanded_by, message.commanded_incarnation, message.command_id = executed.command
    message.applied = float32_field(executed.action)
    message.program_id, message.program = observation.program_id, step.program
    message.hand_index = observation.hand_index
    message.object_count = len(observation.objects)
    message.features = float32_field(observation.objects)
    message.joint_position = float64_field(observation.joint_position)
    message.joint_velocity = float64_field(observation.joint_velocity)
    message.hand_pose = float64_field(observation.hand_pose)
    message.judged = step.verdict is not None
    _write_verdict(message, verdict)
    message.measures = float64_field(np.array(verdict.measures or ()))
    return message


def decode_step(
    message: msg.ObjectFeatures, joints: int | None = None, width: int | None = None
) -> Step:
    """One control step. Raises WireError.

    :param joints: J, joints of the arena's arm; None: any.
    :param width: F, features of an object in the receiver's world; None: any.
    """
    count, hand_index = objects_and_hand("object_features", message)
    received, rest = divmod(len(message.features), count)
    if width not in (None, received) and not rest:
        name, expected = "object_features.features", f"{width} of each of {count} objects"
        raise WireError(name, expected, received, code="wire.feature_names")
    shape, arm = (count, width or received), (joints or len(message.joint_position),)
    objects = read_array("object_features.features", message.features, np.float32, shape, LARGEST)
    hand = (max(7, min(len(message.hand_pose), 8)),)  # a gripper adds a number
    position, velocity, pose = message.joint_position, message.joint_velocity, message.hand_pose
    stamp = message.header.stamp
    observation = Observation(
        episode=message.episode,
        step=message.step,
        stamp_ns=stamp.sec * NS + stamp.nanosec,
        objects=objects,
        joint_position=read_array(
            "object_features.joint_position", position, np.float64, arm, LARGEST
        ),
        joint_velocity=read_array(
            "object_features.joint_velocity", velocity, np.float64, arm, LARGEST
        ),
        hand_index=hand_index,
        program_id=message.program_id,
        hand_pose=read_array("object_features.hand_pose", pose, np.float64, hand, LARGEST),
    )
    executed = verdict = None
    if message.commanded_by:
        command = message.commanded_by, message.commanded_incarnation, message.command_id
        numbers = (arm[0] + hand[0] - 7,)
        applied = read_array("object_features.applied", message.applied, np.float32, numbers)
        executed = Executed(CommandKey(*command), applied)
    if message.judged:
        verdict = _read_verdict(message)
    known = message.program, message.evaluation, executed, message.arena_id
    return Step(observation, verdict, *known)


def arena_of(message: msg.ObjectFeatures) -> str:
    """The id of the arena that sent a step."""
    return str(message.arena_id)


def encode_verdict(step: Step, into: msg.Verdict | None = None) -> msg.Verdict:
    """The verdict on a step that was judged, for people."""
    message = into or msg.Verdict()
    observation = step.observation
    write_stamp(message.stamp, observation.stamp_ns)
    message.episode, message.step = observation.episode, observation.step
    message.evaluation, message.program_id = step.evaluation, observation.program_id
    _write_verdict(message, step.verdict or NOT_JUDGED)
    return message


def _write_verdict(message: msg.ObjectFeatures | msg.Verdict, verdict: Verdict) -> None:
    message.reward, message.satisfied = verdict.reward, verdict.satisfied
    message.distance, message.truncated = verdict.distance, verdict.truncated
    message.stage, message.violated = verdict.stage, verdict.violated


def _read_verdict(message: msg.ObjectFeatures) -> Verdict:
    reward, distance = message.reward, message.distance
    if not math.isfinite(reward):
        name, expected = "object_features.reward", "a finite number"
        raise WireError(name, expected, reward, code="wire.non_finite")
    if not distance >= 0.0:
        expected = "at least 0, or inf"
        raise WireError("object_features.distance", expected, distance, code="wire.range")
    given = message.satisfied, distance, message.truncated, message.stage, message.violated
    measures = read_measures("object_features.measures", message.measures, 1)
    return Verdict(reward, *given, None if measures is None else tuple(measures[0].tolist()))


def objects_and_hand(where: str, message: msg.ObjectFeatures | msg.Trajectory) -> tuple[int, int]:
    """The checked number of objects and the hand's row. Raises WireError."""
    count, hand_index = message.object_count, message.hand_index
    if not 1 <= count <= MAX_OBJECTS:
        raise WireError(f"{where}.object_count", f"1 to {MAX_OBJECTS}", count, code="wire.range")
    if hand_index >= count:
        expected = f"less than {count} objects"
        raise WireError(f"{where}.hand_index", expected, hand_index, code="wire.range")
    return count, hand_index


def encode_joints(
    observation: Observation, joint_names: tuple[str, ...], into: JointState | None = None
) -> JointState:
    """The joint states of one observation, for tools that know no other message of ours."""
    message = into or JointState()
    write_stamp(message.header.stamp, observation.stamp_ns)
    message.name = list(joint_names)
    message.position = float64_field(observation.joint_position)
    message.velocity = float64_field(observation.joint_velocity)
    return message


def encode_command(command: Command, into: msg.JointCommand | None = None) -> msg.JointCommand:
    """An agent's answer to one observation."""
    message = into or msg.JointCommand()
    message.stamp.sec, message.stamp.nanosec = divmod(command.stamp_ns, NS)
    message.episode = command.episode
    message.step = command.step
    message.agent_id, message.incarnation = command.agent_id, command.incarnation
    message.command_id = command.number
    message.policy_version = command.policy_version
    message.action = float32_field(command.action)
    return message


def decode_command(message: msg.JointCommand, numbers: int | None = None) -> Command:
    """A command; the arm clamps it to [-1, 1]. Raises WireError.

    :param numbers: how many the receiver's arm takes (`World.commands`); None: any.
    """
    shape = (len(message.action) if numbers is None else numbers,)
    return Command(
        episode=message.episode,
        step=message.step,
        stamp_ns=message.stamp.sec * NS + message.stamp.nanosec,
        agent_id=message.agent_id,
        policy_version=message.policy_version,
        action=read_array("joint_commands.action", message.action, np.float32, shape),
        incarnation=message.incarnation,
        number=message.command_id,
    )


def step_answered(message: msg.JointCommand) -> int:
    """The stamp of the step that a command answers, ns."""
    return read_stamp(message.stamp)


def encode_clock(stamp_ns: int, into: Clock | None = None) -> Clock:
    """Simulation time for /clock."""
    message = into or Clock()
    write_stamp(message.clock, stamp_ns)
    return message
