"""Experience and weights over the wire."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from helpers.rejections import rejected
from pa_ros.core.experience import AgentKey, PolicySnapshot, TrajectoryKey
from pa_ros.core.published import LearnerInfo, PublishedPolicy
from pa_ros.language import ProgramError, Vocabulary, parse
from pa_ros.wire.errors import WireError
from pa_ros.wire.learning import (
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
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World

DIGEST = "0123456789abcdef"
WORDS = Vocabulary.of(shape=("CUBE", "SPHERE"), color=("RED", "BLUE"))
WORLD = World(PAPER, WORDS, joints=6)


def trajectory(seed: int = 0, length: int = 3, count: int = 5, **fields) -> Trajectory:
    rng = np.random.default_rng(seed)
    defaults = dict(
        agent_id="agent-1",
        sequence=4,
        policy_version=3,
        episode=9,
        first_step=20,
        program=parse("NEAR(HAND, RED)", WORDS),
        hand_index=0,
        objects=rng.normal(size=(length + 1, count, 16)).astype(np.float32),
        arm=rng.normal(size=(length + 1, 18)).astype(np.float32),
        actions=rng.uniform(-1, 1, (length, 6)).astype(np.float32),
        rewards=rng.choice([-1.0, 1.0], length).astype(np.float32),
        ends_episode=True,
        terminated=False,
        world_digest=WORLD.digest,
    )
    return Trajectory(**{**defaults, **fields})


def same(a: Any, b: Any) -> bool:
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a)]
    return all(np.array_equal(x, y) and type(x) is type(y) for x, y in pairs)


@given(
    st.integers(0, 2**32),
    st.integers(1, 20),
    st.integers(1, 8),
    st.integers(0, 2**63),
    st.booleans(),
    st.booleans(),
)
def test_trajectory_survives_the_wire(seed, length, count, number, ends, terminated):
    sent = trajectory(
        seed,
        length,
        count,
        sequence=number,
        incarnation=number + 1,
        held_from=number // 2,
        run_id=f"run {number}",
        stamp_ns=number % 2**60,
        policy_version=number,
        episode=number,
        ends_episode=ends,
        terminated=terminated,
    )
    received = decode_trajectory(encode_trajectory(sent), WORLD)
    assert same(received, sent)
    assert decode_trajectory_key(encode_trajectory(sent)) == sent.key
    assert received.objects.flags.owndata or received.objects.base.flags.owndata


@pytest.mark.parametrize(
    ("field", "value", "error"),
    [
        ("world_digest", "another", "wire.world"),
        ("agent_id", "", "wire.range"),
        ("held_from", 10**6, "wire.range"),
        ("program", "NEAR(HAND, PINK)", "program.unknown_word"),
        ("transition_count", 0, "wire.range"),
        ("transition_count", 2, "wire.size"),
        ("transition_count", 2**32 - 1, "wire.range"),
        ("object_count", 4, "wire.size"),
        ("object_count", 0, "wire.range"),
        ("hand_index", 5, "wire.range"),
        ("objects", [0.0] * 16, "wire.size"),
        ("arm", [0.0] * 18, "wire.size"),
        ("actions", [0.0] * 17 + [math.nan], "wire.non_finite"),
        ("actions", [0.0] * 17 + [1.5], "wire.range"),
        ("rewards", [0.0] * 4, "wire.size"),
        ("rewards", [0.0, math.inf, 0.0], "wire.non_finite"),
    ],
)
def test_malformed_transitions_are_refused(field, value, error):
    message = encode_trajectory(trajectory())
    setattr(message, field, value)
    with rejected(error):
        decode_trajectory(message, WORLD)


def test_a_program_that_does_not_parse_is_refused_with_its_place():
    message = encode_trajectory(trajectory())
    message.program = "NEAR(HAND, AND(RED, PINK))"
    with pytest.raises(ProgramError) as refusal:
        decode_trajectory(message, WORLD)
    assert refusal.value.position == message.program.index("PINK")


LATEST = TrajectoryKey("agent-2", 3, 5)


def policy(**tensors: np.ndarray) -> PublishedPolicy:
    snapshot = PolicySnapshot(7, '{"kind": "programmable"}', DIGEST, tensors)
    accounted = {AgentKey("agent-2", 3): 6, AgentKey("agent-1", 2**63): 5}
    return PublishedPolicy(snapshot, "run-1", "learner-1", accounted, LATEST, stamp_ns=17)


shapes = hnp.array_shapes(min_dims=0, max_dims=3, min_side=1, max_side=5)
arrays = hnp.arrays(np.float32, shapes, elements=st.floats(-10, 10, width=32))


@given(st.dictionaries(st.text("abc.", min_size=1), arrays, min_size=1, max_size=5))
def test_weights_survive_the_wire(tensors):
    sent = policy(**tensors)
    assert weights_checksum(sent.snapshot) == encode_weights(sent).checksum
    received = decode_weights(encode_weights(sent), sent.snapshot.world_digest)
    assert list(received.snapshot.tensors) == list(tensors)
    assert all(np.array_equal(received.snapshot.tensors[k], v) for k, v in tensors.items())
    assert all(received.snapshot.tensors[k].shape == v.shape for k, v in tensors.items())
    assert received.snapshot.version == 7
    assert received.accounted == sent.accounted and received.latest == LATEST
    assert received.name == ("run-1", "learner-1", 7) and received.stamp_ns == 17


def test_of_an_agent_that_nothing_is_accounted_for_of_the_wire_says_nothing():
    sent = replace(policy(a=np.ones(1, np.float32)), accounted={AgentKey("a", 1): 0}, latest=None)
    received = decode_weights(encode_weights(sent))
    assert received.accounted == {} and received.latest is None


LEARNER = LearnerInfo(
    run_id="run", learner_id="learner", first_version=2**40, world_digest=DIGEST,
    architecture="{}", trajectory_steps=100, policy_lag=1, exploration="{}", inference="auto",
    control_period=0.1, thresholds=(0.2,), reward='{"name":"shaped"}', algorithm="td3",
    software_version="0.2", stamp_ns=10**18 + 1,
)  # fmt: skip


def test_a_learners_announcement_survives_the_wire():
    assert decode_learner_info(encode_learner_info(LEARNER)) == LEARNER


@pytest.mark.parametrize(
    ("field", "value", "error"),
    [
        ("wire_version", "1", "wire.version"),
        ("run_id", "", "wire.range"),
        ("learner_id", "", "wire.range"),
        ("trajectory_steps", 0, "wire.range"),
        ("trajectory_steps", 10_001, "wire.range"),
        ("control_period", 0.0, "wire.range"),
        ("control_period", math.nan, "wire.range"),
        ("thresholds", (math.inf,), "wire.range"),
    ],
)
def test_malformed_announcements_are_refused_by_name(field, value, error):
    message = encode_learner_info(LEARNER)
    setattr(message, field, value)
    with rejected(error, match=f"learner_info.{field}"):
        decode_learner_info(message)


def weights_message():
    return encode_weights(policy(a=np.ones((2, 3), np.float32), b=np.zeros(4, np.float32)))


def test_decoded_weights_own_their_memory():
    message = weights_message()
    tensors = decode_weights(message).snapshot.tensors
    message.payload[3] = 0x7F
    assert np.array_equal(tensors["a"], np.ones((2, 3)))
    tensors["a"][0, 0] = 5.0  # writeable


def test_weights_of_other_words_are_refused_naming_both_sides():
    with pytest.raises(WireError) as caught:
        decode_weights(weights_message(), "f" * 16)
    assert all(side in str(caught.value) for side in ("f" * 16, DIGEST))


def _truncate(message):
    message.payload = message.payload[:-4]


def _flip(message):
    message.payload[5] ^= 1


def _nan(message):
    payload = bytearray(message.payload)
    payload[0:4] = np.float32(np.nan).tobytes()
    message.payload = bytes(payload)
    message.checksum = hashlib.sha256(payload).hexdigest()


def _tensor(index, field, value):
    return lambda message: setattr(message.tensors[index], field, value)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (_truncate, "wire.truncated"),
        (lambda message: setattr(message, "payload", []), "wire.truncated"),
        (lambda message: setattr(message, "tensors", []), "wire.truncated"),
        (_tensor(1, "offset", 20), "wire.truncated"),
        (_tensor(1, "name", "a"), "wire.truncated"),
        (_tensor(0, "shape", [3, 3]), "wire.truncated"),
        (_tensor(0, "shape", [2**32 - 1] * 4), "wire.truncated"),
        (_tensor(0, "dtype", "float64"), "wire.dtype"),
        (_flip, "wire.checksum"),
        (lambda message: setattr(message, "checksum", ""), "wire.checksum"),
        (_nan, "wire.non_finite"),
    ],
)
def test_damaged_weights_are_refused(change, error):
    message = weights_message()
    change(message)
    with rejected(error):
        decode_weights(message)


def test_which_object_is_the_hand_survives_the_wire():
    sent = trajectory(hand_index=3)
    assert same(decode_trajectory(encode_trajectory(sent), WORLD), sent)
