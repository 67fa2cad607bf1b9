"""The messages of one control step: records survive them, and malformed ones are rejected."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.messages import observation, same, stamps, texts
from helpers.rejections import rejected
from pa_ros.core.experience import CommandKey, Executed, Step, Verdict
from pa_ros.wire.fields import header_stamp, read_stamp
from pa_ros.wire.robot import decode_driver_joints
from pa_ros.wire.step import (
    Command,
    arena_of,
    decode_command,
    decode_step,
    encode_command,
    encode_joints,
    encode_step,
    encode_verdict,
)

NAMES = ("j1", "j2", "j3", "j4", "j5", "j6")
EXECUTED = Executed(CommandKey("a", 1, 2), np.full(6, 0.25, np.float32))
VERDICT = Verdict(-1.0, False, 1.0, False)
counters = st.integers(0, 2**63)
steps = st.integers(0, 2**32 - 1)
seeds = st.integers(0, 2**32)
distances = st.floats(0, allow_nan=False)


@given(seeds, st.integers(1, 9), counters, steps, stamps, texts, st.booleans(), distances)
def test_a_step_survives_the_wire(seed, count, episode, step, stamp, text, evaluation, distance):
    seen = observation(seed, count)
    seen = replace(seen, episode=episode, step=step, stamp_ns=stamp, program_id=text)
    at = Verdict(1.0, evaluation, distance, not evaluation, step // 2, evaluation, (distance, 0.5))
    verdict = at if seed % 3 else None
    sent = Step(seen, verdict, text, evaluation, EXECUTED if seed % 2 else None, text)
    message = encode_step(sent)
    decoded = decode_step(message)
    assert same(decoded.observation, sent.observation)
    assert replace(decoded, observation=seen) == sent
    assert arena_of(message) == text and header_stamp(message) == stamp
    message.features[0] = message.joint_position[0] = 99.0
    assert same(decoded.observation, seen)  # its arrays own their memory
    shown = encode_verdict(sent)
    assert (shown.step, read_stamp(shown.stamp), shown.program_id) == (step, stamp, text)
    if verdict is not None:
        assert (shown.distance, shown.satisfied) == (distance, evaluation)
        assert (shown.stage, shown.violated) == (step // 2, evaluation)


def test_a_message_that_was_published_before_is_filled_again():
    judged = Verdict(1.0, True, 0.1, True, 3, True)
    message = encode_step(Step(observation(1, 3), judged, "text", True, EXECUTED, "a"))
    again = encode_step(Step(observation(2)), into=message)
    assert again is message and message == encode_step(Step(observation(2)))


def _set(name, value):
    return lambda message: setattr(message, name, value)


def _poke(name, index, value):
    def change(message):
        getattr(message, name)[index] = value

    return change


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (_set("object_count", 4), "wire.feature_names"),  # 20 features each, not 16
        (_set("object_count", 3), "wire.size"),
        (_set("object_count", 0), "wire.range"),
        (_set("hand_index", 5), "wire.range"),
        (_set("hand_pose", [0.0] * 6), "wire.size"),
        (_poke("hand_pose", 0, math.nan), "wire.non_finite"),
        (_poke("features", 17, math.nan), "wire.non_finite"),
        (_poke("features", 17, -3e38), "wire.range"),  # networks would add up to inf
        (_set("joint_position", [0.0] * 5), "wire.size"),
        (_poke("joint_velocity", 2, 1e300), "wire.range"),  # inf in float32
        (_set("applied", [0.0] * 5), "wire.size"),
        (_poke("applied", 5, math.nan), "wire.non_finite"),
        (_set("reward", math.nan), "wire.non_finite"),
        (_set("distance", -0.1), "wire.range"),
    ],
)
def test_malformed_steps_are_rejected(change, code):
    message = encode_step(Step(observation(), VERDICT, executed=EXECUTED))
    change(message)
    with rejected(code, match="object_features.* expected .* received "):
        decode_step(message, joints=6, width=16)


def test_joints_survive_the_wire():
    sent = observation()
    message = encode_joints(sent, NAMES)
    assert message.header.frame_id == ""  # as joint_state_broadcaster leaves it
    position, velocity, stamp_ns = decode_driver_joints(message, NAMES)
    assert np.array_equal(position, sent.joint_position)
    assert np.array_equal(velocity, sent.joint_velocity)
    assert stamp_ns == sent.stamp_ns


@given(seeds, counters, steps, stamps, texts, counters)
def test_a_command_survives_the_wire(seed, episode, step, stamp, agent, version):
    action = np.random.default_rng(seed).uniform(-1, 1, 6).astype(np.float32)
    sent = Command(episode, step, stamp, agent, version, action, seed, version)
    assert same(decode_command(encode_command(sent)), sent)


@pytest.mark.parametrize(
    ("action", "code"), [([0.0] * 7, "wire.size"), ([0.0] * 5 + [math.nan], "wire.non_finite")]
)
def test_malformed_commands_are_rejected(action, code):
    message = encode_command(Command(0, 0, 0, "a", 0, np.zeros(6, np.float32)))
    message.action = action
    with rejected(code, match=r"joint_commands\.action(\[5\])?: expected"):
        decode_command(message, numbers=6)
