"""Scores of episodes, intervals, references, and scores kept in files."""

from dataclasses import replace

import numpy as np
import pytest

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.evaluation.evaluate import by_program, evaluate, run_episodes
from pa_ros.evaluation.scores import gain_over, mean_interval, normalized, normalized_interval

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
