"""Scores of episodes, intervals and references; episodes cut from a stream of steps."""

import math
from dataclasses import replace

import numpy as np
import pytest

from helpers.messages import judged
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.evaluation.evaluate import by_program, evaluate, run_episodes
from pa_ros.evaluation.scores import gain_over, mean_interval, normalized, normalized_interval
from pa_ros.evaluation.tally import EpisodeTally, HeldOutTarget

FAST, TWO_L = preset_named("fast"), design_named("2-L")


def test_an_interval_contains_the_mean_and_shrinks_with_episodes():
    rng = np.random.default_rng(0)
    few, many = mean_interval(rng.normal(size=20)), mean_interval(rng.normal(size=2000))
    for interval in (few, many):
        assert interval.low < interval.mean < interval.high
    assert many.high - many.low < few.high - few.low
    point = mean_interval(np.full(10, -1.0))
    assert (point.low, point.mean, point.high) == (-1.0, -1.0, -1.0)


def test_an_interval_is_of_95_percent():
    """1.96 standard errors of the mean to either side; 90 % would be 1.64."""
    interval = mean_interval(np.tile([-1.0, 1.0], 500))
    assert [interval.low, interval.high] == pytest.approx([-0.062, 0.062], rel=0.08)


def test_normalized_is_zero_at_random_and_one_at_scripted():
    random, scripted = np.full(8, -0.9), np.linspace(0.7, 0.9, 8)
    assert normalized_interval(random[None], random, scripted).mean == pytest.approx(0.0)
    whole = normalized_interval(scripted[None], random, scripted)
    assert (whole.low, whole.mean, whole.high) == pytest.approx((1.0, 1.0, 1.0))
    assert normalized(0.0, -1.0, 1.0) == 0.5
    assert np.isnan(normalized(0.3, 0.5, 0.5))


def test_intervals_widen_with_the_spread_over_seeds_and_over_episodes():
    rng = np.random.default_rng(0)
    random, scripted = np.full(50, -1.0), np.full(50, 1.0)
    over_episodes = np.tile(rng.normal(0, 0.3, 50), (5, 1))
    over_seeds = np.tile(rng.normal(0, 0.3, (5, 1)), (1, 50))
    intervals = [
        normalized_interval(scores, random, scripted)
        for scores in (np.zeros((5, 50)), over_episodes, over_seeds, over_seeds + over_episodes)
    ]
    none, episodes, seeds, both = (interval.high - interval.low for interval in intervals)
    assert none == 0.0
    # Standard errors of the mean: 0.3 / 2 / √50 over episodes, 0.3 / 2 / √5 over seeds.
    assert episodes == pytest.approx(2 * 1.96 * 0.3 / 2 / 50**0.5, rel=0.3)
    assert seeds == pytest.approx(2 * 1.96 * 0.3 / 2 / 5**0.5, rel=0.5)
    assert both > seeds > episodes
    assert np.isnan(normalized_interval(over_seeds, random, random).mean)
    gain = gain_over(over_seeds, np.full(50, -0.5), random, scripted)
    assert gain.mean == pytest.approx(over_seeds.mean() / 2 + 0.25)


def test_the_references_define_the_scale():
    scripted = evaluate(FAST, TWO_L, "scripted", "eval", 5, 3)
    random = evaluate(FAST, TWO_L, "random", "eval", 5, 3)
    assert scripted.normalized.mean == pytest.approx(1.0)
    assert random.normalized.mean == pytest.approx(0.0)
    assert scripted.success_rate == 1.0
    assert scripted.raw.mean > 0.6 > random.raw.mean
    assert scripted.random == random.scores, "the same episodes and the same random actions"


def test_an_agent_receives_observation_and_program_and_is_scored_by_program():
    asked = []

    def still(observation, program):
        asked.append((observation.episode, program))
        return np.zeros(6)

    evaluation = evaluate(FAST, TWO_L, still, "train", 6, 0)
    assert len(asked) == 6 * FAST.episode_steps
    rows = by_program(evaluation)
    assert sum(row.episodes for row in rows) == 6
    assert {row.program for row in rows} == {str(program) for _, program in asked}
    assert "NEAR(HAND, AND(BLUE, SPHERE))" not in {row.program for row in rows}


def test_a_score_leaves_out_the_reward_of_the_reset(monkeypatch):
    task = ReachTask(FAST.changed(episode_steps=3), TWO_L, 0)
    step = task.step

    def rewarded(velocity):
        observation, verdict = step(velocity)
        return observation, replace(verdict, reward=1.0)

    monkeypatch.setattr(task, "step", rewarded)
    scores = list(run_episodes(task, lambda _: np.zeros(6), "train", 2))
    assert [score.reward_per_step for score in scores] == [1.0, 1.0]  # with a reset's -1: 0.5


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
