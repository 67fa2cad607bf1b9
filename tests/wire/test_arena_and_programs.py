"""Arena description, programs, diagnostics and services over the wire."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from visualization_msgs.msg import Marker, MarkerArray

from helpers.rejections import rejected
from msgs_schema.srv import Reset, SetSimulationState, SetSpeed
from pa_ros.language import Vocabulary, parse
from pa_ros.wire.arena import ArenaDescription, Mode, decode_arena_info, encode_arena_info
from pa_ros.wire.diagnostics import Health, decode_diagnostics, encode_diagnostics
from pa_ros.wire.errors import WireError
from pa_ros.wire.program import (
    ProgramRequest,
    ProgramStatus,
    decode_program,
    decode_program_status,
    encode_program,
    encode_program_status,
    program_id_of,
)
from pa_ros.wire.services import (
    SPEEDS,
    Outcome,
    ResetRequest,
    decode_outcome,
    decode_reset,
    decode_speed,
    encode_outcome,
    encode_reset,
    encode_speed,
)
from pa_ros.wire.simulator import ALREADY_IN_TARGET_STATE, ResultCode, encode_result
from pa_ros.wire.views import encode_outlines
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World

texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=200)

WORLD = World(PAPER, Vocabulary.of(shape=("CUBE", "SPHERE"), color=("RED", "BLUE")), joints=6)
ARENA = ArenaDescription(
    mode=Mode.LOCKSTEP,
    design="2-L",
    arm="jaco",
    preset="fast",
    seed=2**63,
    block_count=4,
    world=WORLD,
    training_programs=(parse("NEAR(HAND, RED)", WORLD.vocabulary),),
    joint_names=("a", "b", "c", "d", "e", "f"),
    joint_lower=(-math.inf, -1.0, -1.0, -1.0, -1.0, -1.0),
    joint_upper=(math.inf, 1.0, 1.0, 1.0, 1.0, 1.0),
    speed_limits=(1.0,) * 6,
    control_period=0.1,
    thresholds=(0.2,),
    episode_steps=100,
    reward='{"name":"shaped","weight":0.5}',
    hand_index=0,
    stamp_ns=1_500_000_000,
    arena_id="0a1b",
    software_version="0.1.0",
)


def test_arena_survives_the_wire():
    assert decode_arena_info(encode_arena_info(ARENA)) == ARENA


@pytest.mark.parametrize(
    ("field", "value", "error"),
    [
        ("wire_version", "0", "wire.version"),
        ("mode", 3, "wire.range"),
        ("object_feature_names", ["x"], "wire.feature_names"),
        ("joint_names", ["a"] * 6, "wire.joint_names"),
        ("joint_lower", [0.0] * 5, "wire.size"),
        ("joint_lower", [2.0] * 6, "wire.range"),
        ("joint_upper", [math.nan] * 6, "wire.range"),
        ("speed_limits", [0.0] * 6, "wire.range"),
        ("control_period", math.nan, "wire.range"),
        ("thresholds", (-0.1,), "wire.range"),
        ("thresholds", (0.2, 0.3), "wire.size"),
        ("episode_steps", 0, "wire.range"),
        pytest.param("world", f'{{"joints": {10**400}}}', "config", id="world"),
    ],
)
def test_malformed_arenas_are_refused(field, value, error):
    message = encode_arena_info(ARENA)
    setattr(message, field, value)
    with rejected(error):
        decode_arena_info(message)


@pytest.mark.parametrize("field", ["speed_limits", "thresholds"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 0.0])
def test_each_speed_limit_and_threshold_is_a_positive_number(field, value):
    world = World(PAPER, WORLD.vocabulary.asking("NEAR", "ABOVE"), joints=6)
    arena = dataclasses.replace(ARENA, world=world, thresholds=(0.2, 0.3))
    assert decode_arena_info(encode_arena_info(arena)).thresholds == (0.2, 0.3)
    for i in range(len(getattr(arena, field))):
        message = encode_arena_info(arena)
        getattr(message, field)[i] = value
        with pytest.raises(WireError, match=rf"arena_info\.{field}.* {value}"):
            decode_arena_info(message)


@pytest.mark.parametrize("number", [-1, -100, 2, 2**31 - 1, -(2**31)])
def test_a_strangers_marker_is_no_blocks_outline(number):
    strange = MarkerArray(markers=[Marker(ns="blocks", id=n) for n in (number, 1)])
    outlined = encode_outlines(strange, [1.0, 0.5])
    assert [marker.color.a for marker in outlined.markers] == [0.0, 0.25]


@given(texts.filter(bool), texts)
def test_program_survives_the_wire(program_id, text):
    sent = ProgramRequest(program_id, text)
    assert decode_program(encode_program(sent)) == sent


@given(texts)
def test_a_program_without_id_gets_the_same_one_everywhere(text):
    received = decode_program(encode_program(ProgramRequest("", text)))
    assert received == ProgramRequest(program_id_of(text), text)


def test_a_huge_program_is_cut_and_a_huge_id_refused():
    huge = decode_program(encode_program(ProgramRequest("", "A" * 1_000_000)))
    assert len(huge.text) == 100_000
    with pytest.raises(WireError):
        decode_program(encode_program(ProgramRequest("i" * 257, "")))


@given(texts, texts, st.booleans(), texts, texts, st.integers(-1, 2**31 - 1))
def test_program_status_survives_the_wire(program_id, node, accepted, canonical, reason, position):
    sent = ProgramStatus(
        program_id, node, accepted, canonical, "program.x", reason, position, 1_000_000_007
    )
    assert decode_program_status(encode_program_status(sent)) == sent


def test_unknown_program_status_is_refused():
    message = encode_program_status(ProgramStatus("p", "n", True))
    message.status = 0
    with pytest.raises(WireError):
        decode_program_status(message)


@given(
    st.lists(
        st.builds(
            Health, texts, st.integers(0, 3), texts, st.dictionaries(texts, texts, max_size=3)
        ),
        max_size=3,
    )
)
def test_diagnostics_survive_the_wire(entries):
    assert decode_diagnostics(encode_diagnostics(entries, 3)) == entries


@given(st.none() | st.integers(0, 2**64 - 2), texts, st.booleans())
def test_reset_survives_the_wire(episode, program, evaluation):
    sent = ResetRequest(episode, program, evaluation)
    assert decode_reset(encode_reset(sent)) == sent


@pytest.mark.parametrize("episode", [-1, 2**64 - 1, 10**30])
def test_an_episode_that_no_message_holds_is_refused_and_no_other_begins(episode):
    with pytest.raises(WireError, match="reset.episode: expected 0 to 18446744073709551614"):
        encode_reset(ResetRequest(episode))


def test_a_reset_without_arguments_asks_for_the_next_episode():
    assert decode_reset(Reset.Request()) == ResetRequest()


def test_the_answers_of_services_survive_the_wire():
    done = encode_outcome(Reset.Response(), Outcome(True, episode=3, stamp_ns=5_000_000_006))
    assert decode_outcome(done) == Outcome(True, episode=3, stamp_ns=5_000_000_006)
    failed = Outcome(False, "arena.lockstep", "reason", real_time_factor=0.5)
    assert decode_outcome(encode_outcome(SetSpeed.Response(), failed)) == failed


@pytest.mark.parametrize(
    ("code", "success"),
    [(ResultCode.OK, True), (ALREADY_IN_TARGET_STATE, True), (ResultCode.OPERATION_FAILED, False)],
)
def test_asking_for_the_current_simulation_state_succeeds(code, success):
    response = encode_result(SetSimulationState.Response(), code, "text")
    assert decode_outcome(response) == Outcome(success, reason="text")


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, math.inf])
def test_speeds_outside_the_bounds_are_rejected(speed):
    with rejected("wire.range"):
        decode_speed(encode_speed(speed))


@pytest.mark.parametrize("speed", [0.5, *SPEEDS])
def test_speeds_within_the_bounds_pass(speed):
    assert decode_speed(encode_speed(speed)) == speed
