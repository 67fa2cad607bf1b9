"""One program, heard by two readers, is told once."""

from __future__ import annotations

from pa_ros.core.errors import ConfigError
from pa_ros.ros.programs import Twins, judge
from pa_ros.ros.refusals import Refusals
from pa_ros.wire.records import ProgramRequest

RED, BLUE = ProgramRequest("1", "NEAR(HAND, RED)"), ProgramRequest("2", "NEAR(HAND, BLUE)")
LATCHED, LIVE = 0, 1


def test_a_twin_is_dropped_and_a_repetition_is_not():
    twins = Twins(clock=lambda: 0.0)
    assert twins.is_new(LATCHED, RED) and not twins.is_new(LIVE, RED)
    assert twins.is_new(LIVE, RED) and not twins.is_new(LATCHED, RED)
    assert twins.is_new(LIVE, BLUE) and twins.is_new(LIVE, BLUE)
    assert not twins.is_new(LATCHED, BLUE) and not twins.is_new(LATCHED, BLUE)


def test_what_comes_much_later_is_no_twin():
    now = [0.0]
    twins = Twins(clock=lambda: now[0])
    assert twins.is_new(LATCHED, RED)
    now[0] = 10.0
    assert twins.is_new(LIVE, RED)


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
