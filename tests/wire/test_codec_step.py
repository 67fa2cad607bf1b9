"""One control step over the wire: what goes in comes out, and nothing malformed does."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import JointState

from helpers.rejections import rejected
from pa_ros.core.experience import CommandKey, Executed, Observation, Verdict
from pa_ros.wire.errors import WireError
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.step import (
    Command,
    StepContext,
    StepMark,
    arena_of,
    decode_clock,
    decode_command,
    decode_context,
    decode_joints,
    decode_objects,
    decode_observation,
    decode_step_mark,
    decode_verdict,
    encode_clock,
    encode_command,
    encode_observation,
    encode_verdict,
    is_evaluation,
)

NAMES = ("j1", "j2", "j3", "j4", "j5", "j6")
counters = st.integers(0, 2**63)
stamps = st.integers(0, 2**31 * 10**9 - 1)
texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=40)
seeds = st.integers(0, 2**32)


def observation(seed: int = 0, count: int = 5, **fields) -> Observation:
    rng = np.random.default_rng(seed)
    defaults = dict(
        episode=2,
        step=4,
        stamp_ns=12_300_000_001,
        objects=rng.normal(size=(count, 16)).astype(np.float32),
        joint_position=rng.normal(size=6),
        joint_velocity=rng.normal(size=6),
        hand_index=0,
        program_id="p",
        hand_pose=np.array([0.4, -0.1, 0.3, 0.0, 0.6, 0.0, 0.8]),
    )
    return Observation(**{**defaults, **fields})


def same(a: Any, b: Any) -> bool:
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a)]
    return all(np.array_equal(x, y) and type(x) is type(y) for x, y in pairs)


@given(seeds, st.integers(1, 9), counters, st.integers(0, 2**32 - 1), stamps, texts, st.booleans())
def test_observation_survives_the_wire(seed, count, episode, step, stamp, program, evaluation):
    sent = observation(
        seed,
        count,
        episode=episode,
        step=step,
        stamp_ns=stamp,
        program_id=program,
        hand_index=seed % count,
    )
    executed = Executed(CommandKey("a", seed, episode), np.full(6, 0.25, np.float32))
    context = StepContext(program, evaluation, executed if seed % 2 else None, program)
    features, joints = encode_observation(sent, NAMES, context)
    assert decode_context(features) == context
    assert same(decode_observation(features, joints, NAMES), sent)
    assert arena_of(features) == arena_of(joints) == program
    assert is_evaluation(features) is evaluation
    assert header_stamp(features) == header_stamp(joints) == stamp


def test_the_parts_of_a_step_are_read_alone_as_they_are_together():
    sent = observation(episode=4, step=9, hand_index=2, program_id="p")
    context = StepContext(evaluation=True, program="NEAR(HAND, RED)")
    features, joints = encode_observation(sent, NAMES, context)
    assert decode_step_mark(features) == StepMark(4, 9, True, "p", "NEAR(HAND, RED)")
    objects, hand_index = decode_objects(features)
    assert np.array_equal(objects, sent.objects) and hand_index == 2
    for names in (NAMES, ()):
        position, velocity = decode_joints(joints, names)
        assert np.array_equal(position, sent.joint_position)
        assert np.array_equal(velocity, sent.joint_velocity)
    joints.velocity = joints.velocity[:5]
    with pytest.raises(WireError, match="joint_states.velocity"):
        decode_joints(joints, ())


def test_decoded_arrays_own_their_memory():
    features, joints = encode_observation(observation(), NAMES)
    decoded = decode_observation(features, joints, NAMES)
    before = decoded.objects.copy(), decoded.joint_position.copy()
    features.features[0] = joints.position[0] = 99.0
    assert np.array_equal(decoded.objects, before[0])
    assert np.array_equal(decoded.joint_position, before[1])


def test_joints_may_come_in_any_order_and_more_than_ours():
    sent = observation()
    features, joints = encode_observation(sent, NAMES)
    order = [6, 3, 1, 0, 5, 2, 4]
    everything = [*NAMES, "finger"]
    position, velocity = [*sent.joint_position, 7.0], [*sent.joint_velocity, 8.0]
    joints.name = [everything[i] for i in order]
    joints.position = [position[i] for i in order]
    joints.velocity = [velocity[i] for i in order]
    assert same(decode_observation(features, joints, NAMES), sent)


def _set(name, value):
    return lambda message: setattr(message, name, value)


def _poke(name, index, value):
    def change(message):
        getattr(message, name)[index] = value

    return change


@pytest.mark.parametrize(
    ("which", "change", "error"),
    [
        (0, _set("object_count", 4), "wire.feature_names"),  # 20 features each, not 16
        (0, _set("object_count", 3), "wire.size"),
        (0, _set("hand_pose", [0.0] * 6), "wire.size"),
        (0, _poke("hand_pose", 0, math.nan), "wire.non_finite"),
        (0, _poke("hand_pose", 2, 1e300), "wire.range"),
        (0, _set("object_count", 0), "wire.range"),
        (0, _set("object_count", 2**32 - 1), "wire.range"),
        (0, _set("hand_index", 5), "wire.range"),
        (0, _poke("features", 17, math.nan), "wire.non_finite"),
        (0, _poke("features", 17, -math.inf), "wire.non_finite"),
        (0, _poke("features", 17, -3e38), "wire.range"),  # networks would add up to inf
        (1, _set("position", [0.0] * 5), "wire.size"),
        (1, _set("velocity", []), "wire.size"),
        (1, _poke("velocity", 2, math.nan), "wire.non_finite"),
        (1, _poke("velocity", 2, 1e300), "wire.range"),  # inf as an arm feature, float32
        (1, _poke("position", 0, 1e5), "wire.range"),
        (1, _set("name", ["a", "b", "c", "d", "e", "f"]), "wire.joint_names"),
        (1, _set("name", []), "wire.joint_names"),
        (1, lambda message: setattr(message.header.stamp, "nanosec", 5), "wire.stamp"),
    ],
)
def test_malformed_observations_are_refused(which, change, error):
    messages = encode_observation(observation(), NAMES)
    change(messages[which])
    with rejected(error) as caught:
        decode_observation(*messages, NAMES, 16)
    assert "expected" in str(caught.value) and "received" in str(caught.value)
    assert caught.value.code.startswith("wire.")


def test_features_of_another_width_are_refused_with_both():
    features, joints = encode_observation(observation(), NAMES)
    with pytest.raises(WireError, match="17 of each of 5 objects, received 16"):
        decode_observation(features, joints, NAMES, 17)


def test_non_finite_says_where():
    messages = encode_observation(observation(), NAMES)
    messages[0].features[17] = math.nan
    with pytest.raises(WireError, match=r"features\[1,1\]"):
        decode_observation(*messages, NAMES)


@given(
    counters,
    st.integers(0, 2**32 - 1),
    stamps,
    texts,
    st.booleans(),
    st.booleans(),
    st.floats(0, allow_nan=False),
    st.sampled_from([-1.0, 1.0]),
)
def test_verdict_survives_the_wire(episode, step, stamp, program, satisfied, cut, distance, reward):
    sent = Verdict(episode, step, stamp, program, reward, satisfied, distance, cut)
    message = encode_verdict(sent, cut, program)
    assert arena_of(message) == program
    assert same(decode_verdict(message), sent)
    assert is_evaluation(message) is cut
    assert not is_evaluation(encode_verdict(sent))
    assert decode_step_mark(message) == StepMark(episode, step, cut, program)


@pytest.mark.parametrize(
    ("field", "value", "error"),
    [
        ("reward", math.nan, "wire.non_finite"),
        ("distance", math.nan, "wire.range"),
        ("distance", -0.1, "wire.range"),
    ],
)
def test_malformed_verdicts_are_refused(field, value, error):
    message = encode_verdict(Verdict(0, 0, 0, "", -1.0, False, 1.0, False))
    setattr(message, field, value)
    with rejected(error):
        decode_verdict(message)


@pytest.mark.parametrize("applied", [[], [0.0] * 5, [0.0] * 5 + [math.nan]])
def test_an_executed_command_without_its_action_is_refused(applied):
    executed = Executed(CommandKey("a", 1, 2), np.zeros(6, np.float32))
    features, _ = encode_observation(observation(), NAMES, StepContext(executed=executed))
    features.applied = applied
    with pytest.raises(WireError, match="object_features.applied"):
        decode_context(features, joints=6)


@given(seeds, counters, st.integers(0, 2**32 - 1), stamps, texts, counters)
def test_command_survives_the_wire(seed, episode, step, stamp, agent, version):
    action = np.random.default_rng(seed).uniform(-1, 1, 6).astype(np.float32)
    sent = Command(episode, step, stamp, agent, version, action, seed, version)
    assert same(decode_command(encode_command(sent)), sent)


@pytest.mark.parametrize(
    ("action", "error"),
    [
        ([0.0] * 5, "wire.size"),
        ([0.0] * 7, "wire.size"),
        ([], "wire.size"),
        ([0.0] * 5 + [math.nan], "wire.non_finite"),
        ([math.inf] + [0.0] * 5, "wire.non_finite"),
    ],
)
def test_malformed_commands_are_refused(action, error):
    message = encode_command(Command(0, 0, 0, "a", 0, np.zeros(6, np.float32)))
    message.action = action
    with rejected(error):
        decode_command(message, joints=6)


@pytest.mark.parametrize(("joints", "sent"), [(7, 6), (4, 7)])
def test_a_command_for_another_arm_is_refused_with_both_sizes(joints, sent):
    message = encode_command(Command(0, 0, 0, "a", 0, np.zeros(sent, np.float32)))
    with pytest.raises(WireError, match=f"expected {joints} .*received {sent}"):
        decode_command(message, joints)
    assert len(decode_command(message).action) == sent  # of an arm that isn't known


def test_joint_states_without_joints_are_refused():
    with pytest.raises(WireError, match="joint_states.position"):
        decode_joints(JointState(), ())


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_clock_survives_the_wire(stamp):
    assert decode_clock(encode_clock(stamp)) == stamp
