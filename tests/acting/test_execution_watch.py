"""What counts as executing a program, from an arena's steps."""

from dataclasses import replace

import pytest

from helpers.messages import judged
from pa_ros.acting.execution import ExecutionWatch

STEP_NS = 100_000_000


def taken(step, near, program_id="mine", **fields):
    return judged(step, near, step * STEP_NS, program_id=program_id, **fields)


def run(near_by_step, **options):
    """The result, and the step at which it was known."""
    watch = ExecutionWatch("mine", **options)
    for step, near in enumerate(near_by_step):
        result = watch.observe(taken(step, near))
        if result is not None:
            return result, step
    return None, len(near_by_step)


@pytest.mark.parametrize(
    ("near_by_step", "satisfied", "ended", "known_at", "reached_s", "distance"),
    [
        ([False] * 20 + [True] * 20, True, "held", 30, 2.0, 0.1),
        ([False] * 20 + [True] * 9 + [False] * 100, False, "window", 100, None, 0.5),
        ([False] * 95 + [True] * 10, True, "window", 100, 9.5, 0.1),
    ],
    ids=["held for a second", "passing by is not enough", "near at the end is enough"],
)
def test_what_counts_as_executed(near_by_step, satisfied, ended, known_at, reached_s, distance):
    result, step = run(near_by_step)
    assert (result.satisfied, result.ended, step) == (satisfied, ended, known_at)
    assert (result.reached_s, result.distance) == (reached_s, pytest.approx(distance))
    assert result.watched_s == pytest.approx(known_at / 10)


def test_steps_that_nobody_judged_end_the_watch_unsatisfied_at_the_time_limit():
    watch = ExecutionWatch("mine", window_s=1.0)
    results = [watch.observe(replace(taken(step, True), verdict=None)) for step in range(11)]
    assert results[:-1] == [None] * 10
    assert (results[-1].satisfied, results[-1].ended) == (False, "window")
    assert results[-1].distance == float("inf")


def test_the_end_of_the_episode_ends_the_watch():
    watch = ExecutionWatch("mine")
    assert watch.observe(taken(3, False)) is None
    result = watch.observe(taken(4, True, truncated=True))
    assert (result.satisfied, result.ended, result.watched_s) == (True, "episode", 0.1)


def test_steps_before_the_program_are_ignored_and_another_program_ends_it():
    watch = ExecutionWatch("mine")
    assert watch.observe(taken(0, True, "other")) is None and not watch.begun
    assert watch.observe(taken(1, True)) is None and watch.begun
    result = watch.observe(taken(2, True, "other"))
    assert (result.satisfied, result.ended) == (False, "replaced")


def test_another_episode_under_the_same_id_ends_it():
    watch = ExecutionWatch("mine")
    watch.observe(taken(1, True))
    assert watch.observe(taken(0, True, episode=1)).ended == "replaced"


def test_a_program_that_another_replaces_before_its_first_step_is_over():
    watch = ExecutionWatch("mine")
    assert watch.observe(taken(3, True, "other")) is None
    watch.accepted(3 * STEP_NS)
    watch.accepted(STEP_NS)  # an older answer
    assert watch.observe(taken(3, True, "other")) is None  # the step that stood, once more
    result = watch.observe(taken(4, True, "another"))
    assert (result.satisfied, result.ended, result.watched_s) == (False, "replaced", 0.0)
    assert result.distance == float("inf") and result.reached_s is None and not watch.begun
