"""Which arena counts, and who speaks where one alone should."""

from __future__ import annotations

from dataclasses import replace

import pytest

from helpers.learners import ARENA
from pa_ros.core.experience import AgentKey
from pa_ros.ros.arenas import KNOWN, RIVAL_S, SILENT_S, Arenas, OtherArenaError
from pa_ros.ros.rivals import COMMANDED_S, GONE_S, Commanders, Rivals
from pa_ros.wire.diagnostics import Health

ONE, OTHER = replace(ARENA, arena_id="one"), replace(ARENA, arena_id="other", design="3-D")


def test_the_arena_whose_steps_come_counts_whoever_described_itself_first(clock) -> None:
    arenas = Arenas(clock)
    assert not arenas.step("one")  # nothing is known of it as yet
    assert arenas.announce(OTHER) and arenas.current is OTHER
    assert arenas.announce(ONE) and arenas.current is ONE  # the newest, before any step
    assert arenas.announce(OTHER)
    assert arenas.step("one") and arenas.current is ONE
    assert not arenas.step("one")


def test_a_description_alone_takes_no_arenas_place(clock) -> None:
    arenas = Arenas(clock)
    arenas.announce(ONE)
    arenas.step("one")
    assert not arenas.announce(OTHER) and arenas.current is ONE
    again = replace(ONE, thresholds=(0.5,))
    assert arenas.announce(again) and arenas.current is again
    for name in ("other", "never described"):
        with pytest.raises(OtherArenaError, match=f"'one', whose steps come, got .* '{name}"):
            arenas.step(name)
    assert arenas.rivals == ["other"] and "steps of other arenas come, too (other)" in arenas.alarm
    clock.now += RIVAL_S
    assert arenas.rivals == [] and arenas.alarm == ""


def test_an_arena_that_is_only_said_to_be_there_is_an_alarm_for_a_while(clock) -> None:
    arenas = Arenas(clock)
    arenas.announce(ONE)
    arenas.step("one")
    assert arenas.alarm == ""
    arenas.announce(OTHER)
    assert "another arena describes itself here (other), sends no steps" in arenas.alarm
    clock.now += RIVAL_S
    assert arenas.alarm == ""


def test_an_arena_that_is_silent_gives_way(clock) -> None:
    arenas = Arenas(clock)
    arenas.announce(ONE)
    arenas.step("one")
    arenas.announce(OTHER)
    clock.now += SILENT_S
    assert arenas.step("other") and arenas.current is OTHER
    with pytest.raises(OtherArenaError):
        arenas.step("one")


def test_what_is_remembered_of_arenas_is_bounded_and_the_one_that_counts_stays(clock) -> None:
    arenas = Arenas(clock)
    arenas.announce(ONE)
    arenas.step("one")
    for number in range(10 * KNOWN):
        assert not arenas.announce(replace(ARENA, arena_id=str(number)))
    assert not arenas.step("one") and arenas.current is ONE
    clock.now += SILENT_S
    with pytest.raises(OtherArenaError):
        arenas.step("0")  # forgotten
    assert arenas.step(str(10 * KNOWN - 1))


def _said(instance: str, topic: str = "/a/joint_commands", name: str = "/a/agent") -> Health:
    return Health(name, values={"speaks_on": topic, "instance": instance})


def test_another_process_on_ones_topic_is_an_alarm_while_it_speaks(clock) -> None:
    rivals = Rivals("/a/joint_commands", "me", clock)
    for said in (
        Health("/x"),
        Health("/me", values=rivals.values),
        _said("you", "/b/joint_commands"),
    ):
        rivals.note(said)
    assert rivals.alarm == ""
    rivals.note(_said("you"))
    assert rivals.alarm.startswith("not alone on /a/joint_commands: /a/agent (you): stop all but")
    clock.now += GONE_S
    assert rivals.alarm == ""


def test_several_who_command_the_arm_are_an_alarm(clock) -> None:
    commanders = Commanders(clock)
    commanders.note(AgentKey("a", 1))
    commanders.note(AgentKey("a", 1))
    assert commanders.alarm == ""
    commanders.note(AgentKey("a", 2))
    assert commanders.alarm.startswith("several command the arm (a, a)")
    clock.now += COMMANDED_S / 2
    commanders.note(AgentKey("a", 2))
    clock.now += COMMANDED_S / 2
    assert commanders.alarm == ""
