"""What a learner says of itself: OK only while it learns, and how many trajectories are missed."""

from __future__ import annotations

import pytest

from helpers.waiting import Clock
from learner_node.watch import AT_WORK_S, IDLE_S, REFUSED_S, Watch
from pa_ros.core.experience import AgentKey
from pa_ros.ros.health import ERROR, OK, WARN

A = AgentKey("a", 1)


@pytest.fixture
def watch(clock) -> Watch:
    return Watch(clock)


def frames(clock: Clock) -> float:
    """They grow."""
    return clock.now


def test_trajectories_that_are_all_duplicates_are_not_learning(watch, clock) -> None:
    for _ in range(20):
        watch.came(A)
        assert watch.state("", 0, 0, frames(clock)) == (OK, "learning")
        clock.now += 0.3
    watch.state("", 0, 0, 7.0)
    for _ in range(20):
        watch.came(A)
        clock.now += 0.3
    level, message = watch.state("", 0, 0, 7.0)
    assert level == WARN and message.startswith("trajectories come, and all for 6 s were here be")


def test_it_is_well_only_while_trajectories_come(watch, clock) -> None:
    assert (
        watch.state("", 0, 0, frames(clock))[0] == WARN
        and "parameter learning" in watch.state("", 0, 0, frames(clock))[1]
    )
    for _ in range(20):
        watch.came(A)
        assert watch.state("", 0, 0, frames(clock)) == (OK, "learning")
        clock.now += 0.3
    clock.now += IDLE_S
    level, message = watch.state("", 0, 0, frames(clock))
    assert level == WARN and message.startswith("no trajectory for 2 s: do sim_node")
    assert watch.state("", 0, 3, frames(clock)) == (OK, "learning")  # it is behind, not idle
    watch.came(A)
    assert watch.state("", 0, 0, frames(clock)) == (OK, "learning")


def test_in_real_time_trajectories_come_seldom(watch, clock) -> None:
    for _ in range(20):
        watch.came(A)
        clock.now += 10.0
    assert watch.state("", 0, 0, frames(clock)) == (OK, "learning")
    clock.now += 30.0
    assert watch.state("", 0, 0, frames(clock))[0] == WARN


def test_refusals_and_what_is_missing_are_said_while_they_last(watch, clock) -> None:
    watch.came(A)
    watch.refused("trajectories: expected 5 objects, got 64")
    assert watch.state("", 0, 0, frames(clock)) == (
        WARN,
        "refuses trajectories: expected 5 objects, got 64",
    )
    clock.now += REFUSED_S
    watch.came(A)
    assert watch.state("", 2, 0, frames(clock))[1].startswith("2 trajectories are missing")
    assert watch.at_work(A) and not watch.at_work(AgentKey("a", 2))
    clock.now += AT_WORK_S
    assert not watch.at_work(A)
    assert watch.state("disk full", 0, 0, 0) == (ERROR, "disk full")


def test_an_agent_that_falls_silent_is_named_while_others_are_heard_and_then_forgotten(
    watch, clock
) -> None:
    fast, slow = AgentKey("fast", 1), AgentKey("slow", 1)
    for tick in range(60):
        watch.came(fast)
        if tick % 20 == 0:  # every 6 s, which is usual for it
            watch.came(slow)
        assert watch.state("", 0, 0, frames(clock)) == (OK, "learning")
        clock.now += 0.3
    said = []
    for _ in range(int((AT_WORK_S + 25) / 0.3)):
        watch.came(fast)
        said.append(watch.state("", 0, 0, frames(clock)))
        clock.now += 0.3
    assert [level for level, _ in said[:20]] == [OK] * 20
    assert any(
        level == WARN and message.startswith("no trajectory of 'slow'") for level, message in said
    )
    assert said[-1] == (OK, "learning")


def test_whose_turn_it_is_is_named_when_all_wait_for_it(watch, clock) -> None:
    watch.came(A)
    watch.state("", 0, 3, 7.0, "b")
    clock.now += IDLE_S + 1
    watch.came(A)
    level, message = watch.state("", 0, 3, 7.0, "b")
    assert level == WARN and message.startswith("waits for 'b', whose turn it is")
