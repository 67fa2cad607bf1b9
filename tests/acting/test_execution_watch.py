"""What counts as executing a program, from verdicts alone."""

import pytest

from pa_ros.acting.execution import ExecutionWatch
from pa_ros.core.experience import Verdict

STEP_NS = 100_000_000


def verdict(step, near, program_id="mine", episode=0, truncated=False):
    distance = 0.1 if near else 0.5
    reward = 1.0 if near else -1.0
    return Verdict(episode, step, step * STEP_NS, program_id, reward, near, distance, truncated)


def run(near_by_step, **options):
    """The result, and the step at which it was known."""
    watch = ExecutionWatch("mine", **options)
    for step, near in enumerate(near_by_step):
        result = watch.observe(verdict(step, near))
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


def test_the_end_of_the_episode_ends_the_watch():
    watch = ExecutionWatch("mine")
    assert watch.observe(verdict(3, False)) is None
    result = watch.observe(verdict(4, True, truncated=True))
    assert (result.satisfied, result.ended, result.watched_s) == (True, "episode", 0.1)


def test_steps_before_the_program_are_ignored_and_another_program_ends_it():
    watch = ExecutionWatch("mine")
    assert watch.observe(verdict(0, True, "other")) is None and not watch.begun
    assert watch.observe(verdict(1, True)) is None and watch.begun
    result = watch.observe(verdict(2, True, "other"))
    assert (result.satisfied, result.ended) == (False, "replaced")


def test_another_episode_under_the_same_id_ends_it():
    watch = ExecutionWatch("mine")
    watch.observe(verdict(1, True))
    assert watch.observe(verdict(0, True, episode=1)).ended == "replaced"


def test_a_program_that_another_replaces_before_its_first_step_is_over():
    watch = ExecutionWatch("mine")
    assert watch.observe(verdict(3, True, "other")) is None
    watch.accepted(3 * STEP_NS)
    assert watch.observe(verdict(3, True, "other")) is None  # the step that stood, once more
    result = watch.observe(verdict(4, True, "another"))
    assert (result.satisfied, result.ended, result.watched_s) == (False, "replaced", 0.0)
    assert result.distance == float("inf") and result.reached_s is None and not watch.begun
