"""An arena's description, programs, their ids, and answers of services as messages."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulation_interfaces.srv import SetSimulationState

from helpers import learners
from helpers.messages import texts
from helpers.rejections import rejected
from msgs_schema.srv import Reset, SetSpeed
from pa_ros.language import ProgramError, Vocabulary
from pa_ros.wire.arena import decode_arena_info, describe_robot, encode_arena_info
from pa_ros.wire.program import (
    LONGEST_S,
    ProgramGoal,
    ProgramRequest,
    ProgramStatus,
    decode_goal,
    decode_program,
    decode_program_status,
    encode_goal,
    encode_program,
    encode_program_status,
    program_id_of,
)
from pa_ros.wire.program_book import PROGRAMS, ProgramBook
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

ARENA = replace(
    learners.ARENA,
    seed=2**63,
    joint_lower=(-math.inf, *[-1.0] * 5),
    joint_upper=(math.inf, *[1.0] * 5),
    reward='{"name":"shaped","weight":0.5}',
    stamp_ns=1_500_000_000,
    arena_id="0a1b",
    software_version="0.1.0",
)


def test_near_between_two_objects_has_its_own_threshold():
    texts = "NEAR(HAND, RED)", "NEAR(RED, BLUE)", "ABOVE(HAND, RED)"
    assert [ARENA.threshold(text) for text in texts] == [0.2, 0.1, None]
    goal = "THEN(NEAR(HAND, RED), NEAR(RED, BLUE))"
    assert [ARENA.threshold(goal, stage) for stage in range(3)] == [0.2, 0.1, None]


def test_an_arena_survives_the_wire():
    robot = describe_robot(ARENA.world, dict.fromkeys(ARENA.joint_names, 0.05), 0.05)
    assert (robot.seed, robot.block_count) == (0, 0)
    for sent in (ARENA, robot):
        assert decode_arena_info(encode_arena_info(sent)) == sent


@pytest.mark.parametrize(
    ("field", "value", "code"),
    [
        ("wire_version", "0", "wire.version"),
        ("mode", 3, "wire.range"),
        ("joint_names", ["a"] * 6, "wire.joint_names"),
        ("joint_lower", [0.0] * 5, "wire.size"),
        ("joint_lower", [1.0] * 6, "wire.range"),
        ("joint_upper", [math.nan] * 6, "wire.range"),
        ("control_period", math.nan, "wire.range"),
        ("thresholds", (0.2, 0.3), "wire.size"),
        ("thresholds", (math.inf,), "wire.range"),
        ("speed_limits", [1.0] * 5 + [0.0], "wire.range"),
        ("episode_steps", 0, "wire.range"),
        pytest.param("world", f'{{"joints": {10**400}}}', "config", id="world"),
    ],
)
def test_malformed_arenas_are_rejected(field, value, code):
    message = encode_arena_info(ARENA)
    setattr(message, field, value)
    with rejected(code):
        decode_arena_info(message)


def test_the_times_of_a_goal_are_possible():
    sent = ProgramGoal("text", 0.05, LONGEST_S)
    assert decode_goal(encode_goal(sent)) == sent
    for times in ((-0.1, 0.0), (0.0, math.nan), (0.0, 2 * LONGEST_S)):
        with rejected("wire.range", match="hold_s" if times[1] else "time_limit_s"):
            decode_goal(encode_goal(ProgramGoal("text", *times)))


@given(texts.filter(bool), texts)
def test_a_program_survives_the_wire(program_id, text):
    sent = ProgramRequest(program_id, text)
    assert decode_program(encode_program(sent)) == sent


@given(texts)
def test_a_program_without_an_id_gets_the_same_one_everywhere(text):
    received = decode_program(encode_program(ProgramRequest("", text)))
    assert received == ProgramRequest(program_id_of(text), text)


@given(texts, texts, st.booleans(), texts, texts, st.integers(-1, 2**31 - 1))
def test_a_program_status_survives_the_wire(name, node, accepted, canonical, reason, position):
    sent = ProgramStatus(name, node, accepted, canonical, "code", reason, position, 1_000_000_007)
    assert decode_program_status(encode_program_status(sent)) == sent


def test_an_unknown_program_status_is_rejected():
    message = encode_program_status(ProgramStatus("p", "n", True))
    message.status = 0
    with rejected("wire.range"):
        decode_program_status(message)


@given(st.none() | st.integers(0, 2**64 - 2), texts, st.booleans())
def test_a_reset_survives_the_wire(episode, program, evaluation):
    sent = ResetRequest(episode, program, evaluation)
    assert decode_reset(encode_reset(sent)) == sent
    assert decode_reset(Reset.Request()) == ResetRequest()


def test_the_answers_of_services_survive_the_wire():
    done = Outcome(True, episode=3, stamp_ns=5_000_000_006)
    assert decode_outcome(encode_outcome(Reset.Response(), done)) == done
    failed = Outcome(False, "arena.lockstep", "reason", real_time_factor=0.5)
    assert decode_outcome(encode_outcome(SetSpeed.Response(), failed)) == failed


@pytest.mark.parametrize(
    ("code", "success"),
    [(ResultCode.OK, True), (ALREADY_IN_TARGET_STATE, True), (ResultCode.OPERATION_FAILED, False)],
)
def test_asking_for_the_current_simulation_state_succeeds(code, success):
    response = encode_result(SetSimulationState.Response(), code, "text")
    assert decode_outcome(response) == Outcome(success, reason="text")


@pytest.mark.parametrize("speed", [0.0, math.nan, math.inf])
def test_speeds_outside_the_bounds_are_rejected(speed):
    with rejected("wire.range"):
        decode_speed(encode_speed(speed))
    assert [decode_speed(encode_speed(bound)) for bound in SPEEDS] == list(SPEEDS)


@pytest.fixture
def book() -> ProgramBook:
    return ProgramBook(Vocabulary.of(color=("RED", "BLUE")))


def test_an_accepted_program_is_remembered_by_id_and_parsed_once(book):
    assert book.accept(ProgramRequest("1", "NEAR(HAND,RED )")) == "NEAR(HAND, RED)"
    assert book.accept(ProgramRequest("1", "NEAR(HAND, RED)")) == "NEAR(HAND, RED)"
    assert book.program("NEAR(HAND, RED)") is book.program("NEAR(HAND, RED)")
    assert book.named("1", "NEAR(HAND, RED)") is book.program("NEAR(HAND, RED)")
    assert book.named("1", "NEAR(HAND, BLUE)") is book.named("2", "NEAR(HAND, RED)") is None


def test_a_reused_id_and_an_invalid_text_are_rejected(book):
    book.accept(ProgramRequest("1", "NEAR(HAND, RED)"))
    with rejected("program.id_taken"):
        book.accept(ProgramRequest("1", "NEAR(HAND, BLUE)"))
    with pytest.raises(ProgramError):
        book.accept(ProgramRequest("2", "NEAR(HAND, PINK)"))
    names = [f"other {number}" for number in range(PROGRAMS - 1)]
    for name in (*names, "1", "last"):  # which names the id again, so it is not the oldest
        book.name(name, "NEAR(HAND, RED)")
    with rejected("program.id_taken"):
        book.accept(ProgramRequest("1", "NEAR(HAND, BLUE)"))
    for name in names:
        book.name(name, "NEAR(HAND, RED)")
    assert book.accept(ProgramRequest("1", "NEAR(HAND, BLUE)"))  # the id is forgotten
