"""Messages between learner and agents: trajectories, weights, and the learner's requests."""

from __future__ import annotations

import array
import hashlib
import math

import numpy as np

from msgs_schema import msg
from pa_ros.core.experience import (
    AgentKey,
    Float32,
    LearnerInfo,
    PolicySnapshot,
    PublishedPolicy,
    TrajectoryKey,
)
from pa_ros.language import parse
from pa_ros.wire import WireError
from pa_ros.wire.arena import WIRE_VERSION, check_positive, check_version
from pa_ros.wire.fields import (
    SharedFields,
    float32_field,
    float64_field,
    read_array,
    read_measures,
    read_stamp,
    write_stamp,
)
from pa_ros.wire.step import objects_and_hand
from pa_ros.world import Trajectory
from pa_ros.world.world import World

MAX_TRANSITIONS = 10_000  # of one trajectory
MAX_DIMENSIONS = 8  # of one tensor
DTYPE, ITEM_BYTES = "float32", 4
SAME = SharedFields(LearnerInfo, msg.LearnerInfo)
SAME_OF_SNAPSHOT = SharedFields(PolicySnapshot, msg.PolicyWeights)
SAME_OF_POLICY = SharedFields(PublishedPolicy, msg.PolicyWeights)
SAME_OF_TRAJECTORY = SharedFields(Trajectory, msg.Trajectory)


# Trajectories


def encode_trajectory(trajectory: Trajectory) -> msg.Trajectory:
    """A trajectory of one agent."""
    message = msg.Trajectory()
    write_stamp(message.stamp, trajectory.stamp_ns)
    SAME_OF_TRAJECTORY.write(message, trajectory)
    message.program = str(trajectory.program)
    message.transition_count = len(trajectory)
    message.object_count = trajectory.objects.shape[1]
    for name in ("objects", "arm", "actions", "rewards"):
        setattr(message, name, float32_field(getattr(trajectory, name)))
    if trajectory.measures is not None:
        message.measures = float64_field(trajectory.measures)
    return message


def decode_trajectory_key(message: msg.Trajectory | msg.SequenceMark) -> TrajectoryKey:
    """The name of a trajectory, without the rest of it."""
    return TrajectoryKey(message.agent_id, message.incarnation, message.sequence)


def decode_trajectory(message: msg.Trajectory, world: World) -> Trajectory:
    """A trajectory of the receiver's world. Raises WireError, ProgramError."""
    if message.world_digest != world.digest:
        field, received = "trajectory.world_digest", message.world_digest
        raise WireError(field, world.digest, received, code="wire.world")
    if not message.agent_id:
        raise WireError("trajectory.agent_id", "a name", "''", code="wire.range")
    numbers = message.first_of_run, message.held_from, message.sequence
    if list(numbers) != sorted(numbers):
        field, expected = "trajectory.sequence", "first_of_run <= held_from <= sequence"
        raise WireError(field, expected, numbers, code="wire.range")
    length = message.transition_count
    if not 1 <= length <= MAX_TRANSITIONS:
        field, expected = "trajectory.transition_count", f"1 to {MAX_TRANSITIONS}"
        raise WireError(field, expected, length, code="wire.range")
    count, _ = objects_and_hand("trajectory", message)
    rows = length + 1
    objects = (rows, count, world.object_features)
    actions = (length, world.actions)
    return Trajectory(
        program=parse(message.program, world.vocabulary),
        objects=read_array("trajectory.objects", message.objects, np.float32, objects),
        arm=read_array("trajectory.arm", message.arm, np.float32, (rows, world.arm_features)),
        actions=read_array("trajectory.actions", message.actions, np.float32, actions, largest=1.0),
        rewards=read_array("trajectory.rewards", message.rewards, np.float32, (length,)),
        measures=read_measures("trajectory.measures", message.measures, rows),
        stamp_ns=read_stamp(message.stamp),
        **SAME_OF_TRAJECTORY.read(message),
    )


# The learner's requests


def encode_learner_info(learner: LearnerInfo) -> msg.LearnerInfo:
    """The latched announcement of a learner."""
    message = msg.LearnerInfo()
    write_stamp(message.stamp, learner.stamp_ns)
    SAME.write(message, learner)
    message.thresholds = float64_field(np.asarray(learner.thresholds))
    message.wire_version = WIRE_VERSION
    return message


def decode_learner_info(message: msg.LearnerInfo) -> LearnerInfo:
    """What a learner asks of its agents. Raises WireError."""
    check_version("learner_info", message)
    if not 1 <= message.trajectory_steps <= MAX_TRANSITIONS:
        field, expected = "learner_info.trajectory_steps", f"1 to {MAX_TRANSITIONS}"
        raise WireError(field, expected, message.trajectory_steps, code="wire.range")
    thresholds = tuple(message.thresholds)
    check_positive("learner_info", control_period=(message.control_period,), thresholds=thresholds)
    return LearnerInfo(
        **SAME.read(message), thresholds=thresholds, stamp_ns=read_stamp(message.stamp)
    )


# Weights


def encode_weights(policy: PublishedPolicy) -> msg.PolicyWeights:
    """A snapshot; its tensors follow one another in the payload."""
    snapshot = policy.snapshot
    message = msg.PolicyWeights()
    write_stamp(message.stamp, policy.stamp_ns)
    SAME_OF_POLICY.write(message, policy)
    SAME_OF_SNAPSHOT.write(message, snapshot)
    message.consumed = [
        _mark(TrajectoryKey(*agent, following - 1))
        for agent, following in sorted(policy.accounted.items())
        if following > 0
    ]
    message.latest = [] if policy.latest is None else [_mark(policy.latest)]
    tensors, offset = [], 0
    for name, tensor in snapshot.tensors.items():
        shape = array.array("I", tensor.shape)
        tensors.append(msg.Tensor(name=name, dtype=DTYPE, shape=shape, offset=offset))
        offset += ITEM_BYTES * tensor.size
    payload = _payload(snapshot)
    message.tensors = tensors
    message.payload = array.array("B", payload)
    message.checksum = hashlib.sha256(payload).hexdigest()
    return message


def weights_checksum(snapshot: PolicySnapshot) -> str:
    """The SHA-256 of a snapshot's payload, as its message states it."""
    return hashlib.sha256(_payload(snapshot)).hexdigest()


def decode_weights(message: msg.PolicyWeights, world_digest: str | None = None) -> PublishedPolicy:
    """A snapshot for the world of `world_digest` (None: any). Raises WireError."""
    if world_digest not in (None, message.world_digest):
        field, received = "policy_weights.world_digest", message.world_digest
        raise WireError(field, world_digest, received, code="wire.world")
    return PublishedPolicy(
        PolicySnapshot(tensors=_read_tensors(message), **SAME_OF_SNAPSHOT.read(message)),
        accounted={AgentKey(m.agent_id, m.incarnation): m.sequence + 1 for m in message.consumed},
        latest=next(map(decode_trajectory_key, message.latest), None),
        stamp_ns=read_stamp(message.stamp),
        **SAME_OF_POLICY.read(message),
    )


def _payload(snapshot: PolicySnapshot) -> bytes:
    tensors = snapshot.tensors.values()
    return b"".join(np.ascontiguousarray(tensor, dtype="<f4").tobytes() for tensor in tensors)


def _mark(key: TrajectoryKey) -> msg.SequenceMark:
    return msg.SequenceMark(**key._asdict())


def _read_tensors(message: msg.PolicyWeights) -> dict[str, Float32]:
    """The tensors, which must have unique names and cover the payload without a gap."""
    payload = memoryview(message.payload)
    digest = hashlib.sha256(payload).hexdigest()
    if digest != message.checksum:
        field = "policy_weights.checksum"
        raise WireError(field, digest, message.checksum, code="wire.checksum")
    end, tensors = 0, dict[str, Float32]()
    for tensor in message.tensors:
        where, shape = f"policy_weights.tensors[{tensor.name!r}]", tuple(tensor.shape)
        count = math.prod(shape)
        if tensor.dtype != DTYPE:
            raise WireError(f"{where}.dtype", DTYPE, tensor.dtype, code="wire.dtype")
        if len(shape) > MAX_DIMENSIONS or not 0 < ITEM_BYTES * count <= len(payload) - end:
            expected = f"1 to {(len(payload) - end) // ITEM_BYTES} numbers"
            raise WireError(f"{where}.shape", expected, shape, code="wire.size")
        if tensor.name in tensors or tensor.offset != end:
            expected = f"{end}, and a name that no other tensor has"
            raise WireError(f"{where}.offset", expected, tensor.offset, code="wire.truncated")
        values = np.frombuffer(payload, "<f4", count, end)
        if not np.isfinite(values).all():
            raise WireError(where, "finite numbers", "others", code="wire.non_finite")
        tensors[tensor.name] = values.astype(np.float32).reshape(shape)
        end += ITEM_BYTES * count
    if end != len(payload) or not tensors:
        expected = f"{end} bytes, more than 0"
        raise WireError("policy_weights.payload", expected, len(payload), code="wire.truncated")
    return tensors
