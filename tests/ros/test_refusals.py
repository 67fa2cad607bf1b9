"""Refusals are counted one by one and logged now and then; programs are limited in rate."""

import threading

import pytest

from pa_ros.core.errors import ConfigError, PaError
from pa_ros.ros.refusals import (
    KEPT_S,
    PROGRAMS_AT_ONCE,
    PROGRAMS_PER_S,
    RateLimiter,
    Refusals,
    answer_program,
)
from pa_ros.wire import WireError
from pa_ros.wire.program import ProgramRequest

RED = ProgramRequest("1", "NEAR(HAND, RED)")


@pytest.fixture
def lines() -> list[str]:
    return []


@pytest.fixture
def refusals(lines, clock) -> Refusals:
    return Refusals(lines.append, clock, period_s=5.0)


def test_refusals_are_counted_by_code_and_the_first_is_logged(refusals, lines):
    for _ in range(3):
        refusals.refuse("topic", WireError("field", 6, 5, "wire.size"))
    refusals.refuse("topic", ConfigError("no"))
    assert refusals.total == 4
    assert refusals.values() == {"refused.config": "1", "refused.wire.size": "3"}
    assert lines == [
        "refused: topic: [wire.size] field: expected 6, received 5",
        "refused: topic: [config] no",
    ]


def test_many_refusals_are_logged_once_a_period_with_their_number(refusals, lines, clock):
    for _ in range(80):
        refusals.refuse("topic", ConfigError("no"))
        clock.now += 0.125
    assert len(lines) == 2 and lines[1].endswith("(39 more since the last report)")


def test_a_guarded_callback_refuses_bad_input_and_passes_bugs_on(refusals):
    def callback(message: str) -> None:
        raise {"bad": ConfigError("no"), "bug": ZeroDivisionError()}[message]

    guarded = refusals.guard("topic", callback)
    guarded("bad")
    assert refusals.counts["config"] == 1
    with pytest.raises(ZeroDivisionError):
        guarded("bug")


def test_a_refusal_is_remembered_until_a_message_of_its_topic_is_accepted(refusals, clock):
    def callback(message: str) -> None:
        if message != "good":
            raise ConfigError(message)

    joints, tf = refusals.guard("joints", callback), refusals.guard("tf", callback)
    joints("no velocities")
    clock.now += 0.5
    tf("no frame")
    refusals.refuse("the arm holds", ConfigError("no joints"))  # not a topic
    said = [("tf", "no frame"), ("joints", "no velocities")]
    joints("good")  # of another publisher, while the bad ones go on
    assert refusals.newest == said
    tf("good")
    clock.now += KEPT_S
    tf("no frame\nwith a place")
    assert refusals.newest == said[:1]


def test_a_message_of_which_a_part_is_refused_is_not_an_accepted_one(refusals, clock):
    detections = refusals.guard("detections", lambda why: refusals.refuse("detections", why))
    for _ in range(2):
        detections(ConfigError("no pose"))
        clock.now += KEPT_S
        assert refusals.newest == [("detections", "no pose")]


def test_refusals_of_several_threads_are_all_counted(refusals, lines):
    def refuse_often() -> None:
        for _ in range(2000):
            refusals.refuse("topic", ConfigError("no"))

    threads = [threading.Thread(target=refuse_often) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert refusals.total == 8000 and lines == ["refused: topic: [config] no"]


def test_a_programs_answer_has_its_canonical_text_or_reason_and_position(refusals):
    accepted = answer_program(RED, "/sim_node", 5, lambda request: request.text, refusals)
    assert (accepted.accepted, accepted.canonical, accepted.stamp_ns) == (True, RED.text, 5)

    class HereError(PaError):
        code, position = "program.here", 7

    def refuse(_: ProgramRequest) -> str:
        raise HereError("no")

    refused = answer_program(RED, "/sim_node", 5, refuse, refusals)
    assert (refused.accepted, refused.code, refused.reason) == (False, "program.here", "no")
    assert (refused.program_id, refused.position, refusals.total) == ("1", 7, 1)


def test_the_rate_of_programs_is_limited(clock):
    limiter, checked = RateLimiter(clock), 0
    for _ in range(int(PROGRAMS_AT_ONCE)):
        limiter.check()
    for _ in range(1000):  # one second of 1 kHz
        clock.now += 1e-3
        try:
            limiter.check()
            checked += 1
        except PaError as error:
            assert error.code == "program.too_many"
    assert checked == pytest.approx(PROGRAMS_PER_S, abs=2)
