"""Episodes cut from a stream of steps, and when the target is reached."""

import math

import pytest

from helpers.messages import judged
from pa_ros.evaluation.tally import EpisodeTally, HeldOutTarget


class Stream:
    """Steps of whole episodes, as an arena publishes them."""

    def __init__(self) -> None:
        self.tally = EpisodeTally()
        self._stamp_ns = 0

    def step(self, step, near, truncated=False, held_out=False):
        self._stamp_ns += 100_000_000
        return judged(step, near, self._stamp_ns, truncated=truncated, evaluation=held_out)

    def episode(self, near_by_step, held_out=False):
        self.tally.observe(self.step(0, False, held_out=held_out))
        last = len(near_by_step)
        for step, near in enumerate(near_by_step, start=1):
            taken = self.step(step, near, step == last, held_out)
            self.tally.observe(taken)
            self.tally.observe(taken)  # repeated: ignored
        return self.tally.episodes[-1]


def test_an_episode_is_scored_over_its_actions():
    result = Stream().episode([False, True, True, True])
    assert (result.reward_per_step, result.success) == (0.5, True)
    assert not result.held_out


def test_held_out_episodes_do_not_count_as_training_frames():
    stream = Stream()
    stream.episode([True] * 5, held_out=True)
    assert stream.tally.frames == 0
    stream.episode([True] * 5)
    assert stream.tally.frames == 5


def test_an_episode_without_its_start_or_end_is_left_out():
    stream = Stream()
    for step in (7, 8):
        stream.tally.observe(stream.step(step, True, step == 8))
    stream.tally.observe(stream.step(0, False))
    stream.tally.observe(stream.step(1, True))
    stream.episode([False, False])
    assert [episode.reward_per_step for episode in stream.tally.episodes] == [-1.0]


def test_the_target_needs_enough_episodes_score_and_success():
    target = HeldOutTarget(random=-1.0, scripted=0.9, episodes=4)
    stream = Stream()
    assert math.isnan(target.score(stream.tally)[0])
    for _ in range(3):
        stream.episode([True] * 10, held_out=True)
    assert not target.reached(stream.tally)
    stream.episode([True] * 10, held_out=True)
    assert target.reached(stream.tally)
    assert target.score(stream.tally) == (pytest.approx(2 / 1.9), 1.0)
    stream.episode([True] * 9 + [False], held_out=True)  # score 1.03, success 3 of 4
    assert not target.reached(stream.tally)
    one = HeldOutTarget(random=-1.0, scripted=0.9, episodes=1)
    stream.episode([False] * 9 + [True], held_out=True)  # success without score
    assert one.score(stream.tally)[1] == 1.0 and not one.reached(stream.tally)
