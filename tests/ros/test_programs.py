"""What a node answers to a program."""

from __future__ import annotations

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.ros.programs import BURST, PER_S, Pace, TooManyProgramsError, judge
from pa_ros.ros.refusals import Refusals
from pa_ros.wire.program import ProgramRequest

RED, BLUE = ProgramRequest("1", "NEAR(HAND, RED)"), ProgramRequest("2", "NEAR(HAND, BLUE)")


def test_a_judgement_says_what_and_where():
    refusals = Refusals(lambda _: None)
    accepted = judge(RED, "/sim_node", 5, lambda request: request.text, refusals)
    assert (accepted.accepted, accepted.canonical, accepted.stamp_ns) == (True, RED.text, 5)

    class HereError(ConfigError):
        position = 7

    def refuse(_: ProgramRequest) -> str:
        raise HereError("no")

    refused = judge(BLUE, "/sim_node", 5, refuse, refusals)
    assert (refused.accepted, refused.code, refused.reason) == (False, "config", "no")
    assert (refused.program_id, refused.position, refusals.total) == ("2", 7, 1)


def test_only_so_many_programs_a_second_are_judged():
    now = [0.0]
    pace = Pace(lambda: now[0])
    for _ in range(int(BURST)):
        pace.check()
    with pytest.raises(TooManyProgramsError, match="at most 50 programs a second"):
        pace.check()
    judged = 0
    for _ in range(1000):  # a second of 1 kHz
        now[0] += 1e-3
        try:
            pace.check()
            judged += 1
        except TooManyProgramsError:
            continue
    assert judged == pytest.approx(PER_S, abs=2)
    now[0] += 60.0
    for _ in range(int(BURST)):
        pace.check()
