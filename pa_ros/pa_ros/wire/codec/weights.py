"""Weights of a policy (PolicyWeights): raw float32 in one checked payload, never pickled."""

from __future__ import annotations

import array
import hashlib
import math

import numpy as np

from pa_ros.core.experience import AgentKey, Float32, PolicySnapshot, TrajectoryKey
from pa_ros.core.published import PublishedPolicy
from pa_ros.wire import errors
from pa_ros.wire.codec.stamp import read_stamp, write_stamp
from pa_ros.wire.interfaces import PolicyWeights, SequenceMark, Tensor

_DTYPE = "float32"
_ITEM = 4  # bytes
MAX_DIMENSIONS = 8


def encode_weights(policy: PublishedPolicy) -> PolicyWeights:
    """A snapshot, its tensors one after the other in the payload."""
    snapshot = policy.snapshot
    message = PolicyWeights()
    write_stamp(message.stamp, policy.stamp_ns)
    message.run_id, message.learner_id = policy.run_id, policy.learner_id
    message.version = snapshot.version
    message.architecture = snapshot.architecture
    message.world_digest = snapshot.world_digest
    message.consumed = [
        _mark(TrajectoryKey(*agent, following - 1))
        for agent, following in sorted(policy.accounted.items())
        if following > 0
    ]
    message.latest = [] if policy.latest is None else [_mark(policy.latest)]
    tensors, offset = [], 0
    for name, tensor in snapshot.tensors.items():
        shape = array.array("I", tensor.shape)
        tensors.append(Tensor(name=name, dtype=_DTYPE, shape=shape, offset=offset))
        offset += _ITEM * tensor.size
    payload = _payload(snapshot)
    message.tensors = tensors
    message.payload = array.array("B", payload)
    message.checksum = hashlib.sha256(payload).hexdigest()
    return message


def weights_checksum(snapshot: PolicySnapshot) -> str:
    """SHA-256 of a snapshot's payload, as its message states it."""
    return hashlib.sha256(_payload(snapshot)).hexdigest()


def _payload(snapshot: PolicySnapshot) -> bytes:
    tensors = snapshot.tensors.values()
    return b"".join(np.ascontiguousarray(tensor, dtype="<f4").tobytes() for tensor in tensors)


def decode_weights(message: PolicyWeights, world_digest: str | None = None) -> PublishedPolicy:
    """A snapshot, refused unless it is of the vocabulary named (None: of any).

    Raises WorldError, ChecksumError, TruncatedError, DtypeError, SizeError, NonFiniteError.
    """
    if world_digest not in (None, message.world_digest):
        field, received = "policy_weights.world_digest", message.world_digest
        raise errors.WorldError(field, world_digest, received)
    tensors = _read_tensors(message)
    snapshot = PolicySnapshot(
        version=message.version,
        architecture=message.architecture,
        world_digest=message.world_digest,
        tensors=tensors,
    )
    return PublishedPolicy(
        snapshot,
        message.run_id,
        message.learner_id,
        {AgentKey(m.agent_id, m.incarnation): m.sequence + 1 for m in message.consumed},
        next((TrajectoryKey(m.agent_id, m.incarnation, m.sequence) for m in message.latest), None),
        read_stamp(message.stamp),
    )


def _mark(key: TrajectoryKey) -> SequenceMark:
    return SequenceMark(**key._asdict())


def _read_tensors(message: PolicyWeights) -> dict[str, Float32]:
    payload = memoryview(message.payload)
    _check_coverage(message, len(payload))
    digest = hashlib.sha256(payload).hexdigest()
    if digest != message.checksum:
        raise errors.ChecksumError("policy_weights.checksum", digest, message.checksum)
    tensors: dict[str, Float32] = {}
    for tensor in message.tensors:
        values = np.frombuffer(payload, "<f4", math.prod(tensor.shape), tensor.offset)
        if not np.isfinite(values).all():
            raise errors.NonFiniteError(f"policy_weights.{tensor.name}", "finite numbers", "others")
        tensors[tensor.name] = values.astype(np.float32).reshape(tuple(tensor.shape))
    return tensors


def _check_coverage(message: PolicyWeights, size: int) -> None:
    """Tensors follow one another without gap from 0 to the payload's end, each named once."""
    end, names = 0, set()
    for tensor in message.tensors:
        where = f"policy_weights.tensors[{tensor.name!r}]"
        if tensor.dtype != _DTYPE:
            raise errors.DtypeError(f"{where}.dtype", _DTYPE, tensor.dtype)
        if len(tensor.shape) > MAX_DIMENSIONS or 0 in tensor.shape:
            expected = f"at most {MAX_DIMENSIONS} sizes, none of them 0"
            raise errors.SizeError(f"{where}.shape", expected, list(tensor.shape))
        if tensor.name in names or tensor.offset != end:
            raise errors.TruncatedError(f"{where}.offset", f"{end}, and named once", tensor.offset)
        names.add(tensor.name)
        end += _ITEM * math.prod(tensor.shape)
    if end != size or not names:
        raise errors.TruncatedError("policy_weights.payload", f"{end} bytes, more than 0", size)
