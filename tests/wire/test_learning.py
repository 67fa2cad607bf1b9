"""Trajectories, weights and a learner's announcement as messages."""

import hashlib
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from helpers.messages import same
from helpers.rejections import rejected
from helpers.worlds import WORLD, random_trajectory
from pa_ros.core.experience import (
    AgentKey,
    LearnerInfo,
    PolicySnapshot,
    PublishedPolicy,
    TrajectoryKey,
)
from pa_ros.language import ProgramError
from pa_ros.wire.learning import (
    MAX_DIMENSIONS,
    decode_learner_info,
    decode_trajectory,
    decode_trajectory_key,
    decode_weights,
    encode_learner_info,
    encode_trajectory,
    encode_weights,
    weights_checksum,
)
from pa_ros.world import Trajectory

DIGEST = "0123456789abcdef"
LATEST = TrajectoryKey("agent-2", 3, 5)
LEARNER = LearnerInfo(
    run_id="run", learner_id="learner", first_version=2**40, world_digest=DIGEST,
    architecture="{}", trajectory_steps=100, policy_lag=1, exploration="{}", inference="auto",
    control_period=0.1, thresholds=(0.2,), reward='{"name":"shaped"}', algorithm="td3",
    software_version="0.2", stamp_ns=10**18 + 1,
)  # fmt: skip


def trajectory(seed: int = 0, length: int = 3, count: int = 5, number: int = 4) -> Trajectory:
    rng = np.random.default_rng(seed)
    return random_trajectory(
        rng,
        length,
        objects=rng.normal(size=(length + 1, count, 16)).astype(np.float32),
        agent_id="agent-1",
        incarnation=number + 1,
        sequence=number,
        held_from=number // 2,
        first_of_run=number // 3,
        run_id=f"run {number}",
        policy_version=number,
        episode=number,
        first_step=20,
        hand_index=seed % count,
        ends_episode=seed % 2 == 0,
        terminated=seed % 3 == 0,
        stamp_ns=number % 2**60,
    )


@given(st.integers(0, 2**32), st.integers(1, 20), st.integers(1, 8), st.integers(0, 2**63))
def test_a_trajectory_survives_the_wire(seed, length, count, number):
    sent = trajectory(seed, length, count, number)
    message = encode_trajectory(sent)
    received = decode_trajectory(message, WORLD)
    assert same(received, sent)
    assert decode_trajectory_key(message) == sent.key
    message.rewards[0] = 5.0
    assert same(received, sent)


@pytest.mark.parametrize(
    ("field", "value", "code"),
    [
        ("world_digest", "another", "wire.world"),
        ("agent_id", "", "wire.range"),
        ("held_from", 10**6, "wire.range"),
        ("transition_count", 0, "wire.range"),
        ("transition_count", 2, "wire.size"),
        ("object_count", 0, "wire.range"),
        ("hand_index", 5, "wire.range"),
        ("arm", [0.0] * 18, "wire.size"),
        ("actions", [0.0] * 17 + [math.nan], "wire.non_finite"),
        ("actions", [0.0] * 17 + [1.5], "wire.range"),
        ("rewards", [0.0, math.inf, 0.0], "wire.non_finite"),
        ("measures", [0.1] * 5, "wire.range"),
        ("measures", [0.1] * 3 + [-0.1], "wire.range"),
    ],
)
def test_malformed_trajectories_are_rejected(field, value, code):
    message = encode_trajectory(trajectory())
    setattr(message, field, value)
    with rejected(code):
        decode_trajectory(message, WORLD)


def test_a_program_that_does_not_parse_is_rejected_with_its_place():
    message = encode_trajectory(trajectory())
    message.program = "NEAR(HAND, AND(RED, PINK))"
    with pytest.raises(ProgramError) as caught:
        decode_trajectory(message, WORLD)
    assert caught.value.position == message.program.index("PINK")


def policy(**tensors: np.ndarray) -> PublishedPolicy:
    snapshot = PolicySnapshot(7, '{"kind": "programmable"}', DIGEST, tensors)
    accounted = {AgentKey("agent-2", 3): 6, AgentKey("agent-1", 2**63): 1}
    return PublishedPolicy(snapshot, "run-1", "learner-1", accounted, LATEST, stamp_ns=17)


def small_policy(b: tuple[int, ...] = (4,)) -> PublishedPolicy:
    return policy(a=np.ones((2, 3), np.float32), b=np.zeros(b, np.float32))


def test_what_is_just_allowed_survives_the_wire():
    most = (1,) * MAX_DIMENSIONS
    sent = replace(small_policy(most), accounted={AgentKey("a", 1): 0, AgentKey("b", 1): 1})
    received = decode_weights(encode_weights(sent))
    assert received.snapshot.tensors["b"].shape == most
    assert received.accounted == {AgentKey("b", 1): 1}, "nothing of the other was taken in"
    with rejected("wire.size", match=r"'b'\]\.shape: expected 1 to 1 numbers"):
        decode_weights(encode_weights(small_policy((1, *most))))
    full = replace(trajectory(), actions=np.ones((3, 6), np.float32), measures=np.zeros((4, 2)))
    assert same(decode_trajectory(encode_trajectory(full), WORLD), full)


shapes = hnp.array_shapes(min_dims=0, max_dims=3, min_side=1, max_side=5)
arrays = hnp.arrays(np.float32, shapes, elements=st.floats(-10, 10, width=32))


@given(st.dictionaries(st.text("abc.", min_size=1), arrays, min_size=1, max_size=5))
def test_weights_survive_the_wire(tensors):
    sent = policy(**tensors)
    message = encode_weights(sent)
    assert weights_checksum(sent.snapshot) == message.checksum
    received = decode_weights(message, DIGEST)
    message.payload[0] ^= 0x7F  # the decoded tensors own their memory
    assert list(received.snapshot.tensors) == list(tensors)
    assert all(np.array_equal(received.snapshot.tensors[k], v) for k, v in tensors.items())
    assert received.accounted == sent.accounted and received.latest == LATEST
    assert received.name == ("run-1", "learner-1", 7) and received.stamp_ns == 17


def test_weights_for_another_world_are_rejected_naming_both():
    with rejected("wire.world", match=f"{'f' * 16}, received {DIGEST}"):
        decode_weights(encode_weights(small_policy()), "f" * 16)


def _nan(message):
    payload = bytearray(message.payload)
    payload[0:4] = np.float32(np.nan).tobytes()
    message.payload = bytes(payload)
    message.checksum = hashlib.sha256(payload).hexdigest()


def _set(field, value):
    return lambda message: setattr(message, field, value)


def _tensor(index, field, value):
    return lambda message: setattr(message.tensors[index], field, value)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (_set("tensors", []), "wire.truncated"),
        (_tensor(1, "offset", 20), "wire.truncated"),
        (_tensor(1, "name", "a"), "wire.truncated"),
        (_tensor(1, "shape", [2**32 - 1] * 4), "wire.size"),
        (_tensor(0, "shape", [0, 6]), "wire.size"),
        (_tensor(0, "dtype", "float64"), "wire.dtype"),
        (lambda message: message.payload.__setitem__(5, 1), "wire.checksum"),
        (_nan, "wire.non_finite"),
    ],
)
def test_damaged_weights_are_rejected(change, code):
    message = encode_weights(small_policy())
    change(message)
    with rejected(code):
        decode_weights(message)


def test_a_learners_announcement_survives_the_wire():
    assert decode_learner_info(encode_learner_info(LEARNER)) == LEARNER


@pytest.mark.parametrize(
    ("field", "value", "code"),
    [
        ("wire_version", "1", "wire.version"),
        ("trajectory_steps", 0, "wire.range"),
        ("control_period", math.nan, "wire.range"),
        ("thresholds", (math.inf,), "wire.range"),
    ],
)
def test_malformed_announcements_are_rejected(field, value, code):
    message = encode_learner_info(LEARNER)
    setattr(message, field, value)
    with rejected(code, match=f"learner_info.{field}"):
        decode_learner_info(message)
