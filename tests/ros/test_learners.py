"""Which learner counts: the one that is acted for, while it lives; and who else speaks is said."""

from __future__ import annotations

from dataclasses import replace

import pytest

from helpers.learners import LEARNER, again
from pa_ros.ros.learners import KNOWN, SAID_S, UNKNOWN_S, Learners
from pa_ros.ros.rivals import GONE_S

OTHER = replace(LEARNER, learner_id="other", run_id="another run", stamp_ns=9)


@pytest.fixture
def learners(clock) -> Learners:
    learners = Learners(clock)
    assert learners.announce(LEARNER)
    return learners


def test_a_learner_of_another_run_counts_only_when_the_first_has_gone(learners, clock) -> None:
    assert not learners.announce(OTHER) and learners.current is LEARNER
    for _ in range(5):
        clock.now += GONE_S / 2
        assert not learners.heard("learner") and not learners.heard("other")
        assert "other learners run, too (other)" in learners.alarm
    clock.now += GONE_S
    assert learners.heard("other") and learners.current is OTHER and learners.alarm == ""
    assert not learners.heard("learner")  # it only slept: it gets the agents back ...
    assert learners.current is OTHER and "(learner)" in learners.alarm
    clock.now += GONE_S
    assert learners.weights("learner") and learners.current is LEARNER  # ... once it is alone


def test_a_learner_started_again_takes_its_own_place_at_once(learners) -> None:
    resumed = again(LEARNER, version=7)
    assert learners.announce(resumed) and learners.current is resumed
    assert not learners.announce(LEARNER) and not learners.heard("learner")
    assert learners.current is resumed


def test_a_learner_started_again_where_the_clock_is_behind_is_followed_in_the_end(
    learners, clock
) -> None:
    behind = replace(again(LEARNER, version=7), stamp_ns=LEARNER.stamp_ns - 60 * 10**9)
    assert not learners.announce(behind)
    clock.now += GONE_S
    assert learners.heard(behind.learner_id) and learners.current is behind


def test_weights_of_a_learner_that_never_announces_itself_are_said(learners, clock) -> None:
    assert not learners.weights("nobody")
    assert learners.alarm == ""  # its announcement may be on its way
    clock.now += UNKNOWN_S
    assert "never announced itself (nobody)" in learners.alarm
    clock.now += SAID_S
    assert learners.alarm == ""
    learners.weights("late")
    learners.announce(replace(OTHER, learner_id="late"))
    clock.now += GONE_S
    assert learners.alarm == ""


def test_what_is_remembered_of_learners_is_bounded(learners) -> None:
    for number in range(10 * KNOWN):
        learners.weights(f"nobody {number}")
        learners.announce(replace(OTHER, learner_id=str(number)))
    assert learners.current is LEARNER
    assert len(learners.alarm) < 40 * KNOWN
    assert not learners.heard("0")
