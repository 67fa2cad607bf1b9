"""Exploration noise: its moments, and that an episode's noise is the episode's own."""

import math
from itertools import groupby

import numpy as np

from pa_ros.acting.config import ExplorationConfig
from pa_ros.acting.exploration import ExplorationNoise


def noise(period_s: float = 0.1, seed: int = 3) -> ExplorationNoise:
    return ExplorationNoise(ExplorationConfig(), period_s, seed, actions=6)


def series(made: ExplorationNoise, episode: int, steps: int = 5) -> np.ndarray:
    """Noise of one episode, [T, 6]."""
    return np.array([made.sample(episode) for _ in range(steps)])


def test_moments() -> None:
    """Zero mean, the standard deviation promised at every step, correlation e^(−θt)."""
    made = noise()
    x = np.array([series(made, episode, 11) for episode in range(2000)])
    np.testing.assert_allclose(x.mean((0, 2)), 0.0, atol=0.01)
    np.testing.assert_allclose(x.std((0, 2)), 0.3, rtol=0.03)
    correlation = (x[:, 0] * x[:, 10]).mean() / (x[:, 0].std() * x[:, 10].std())
    assert abs(correlation - math.exp(-1.0)) < 0.03


def test_seed_and_episode_determine_the_noise() -> None:
    first = noise()
    seventh = series(first, 7)
    assert not np.array_equal(seventh, series(first, 8))
    np.testing.assert_array_equal(seventh, series(noise(), 7))
    assert not np.array_equal(seventh, series(noise(seed=4), 7))


def test_the_control_period_decides_how_fast_it_changes() -> None:
    quick, slow = series(noise(0.1), 0), series(noise(1.0), 0)
    np.testing.assert_array_equal(quick[0], slow[0])  # where it starts
    assert not np.array_equal(quick[1], slow[1])


def test_at_times_a_random_action_is_held_instead() -> None:
    made = ExplorationNoise(ExplorationConfig(sigma=0.0, held=0.3), 0.1, 3, actions=2)
    own = np.full(2, 0.5, np.float32)
    acted = np.array([[made.explore(own, episode) for _ in range(100)] for episode in range(50)])
    held = (acted != own).any(-1)
    assert 0.15 < held.mean() < 0.35
    same = (acted[:, 1:] == acted[:, :-1]).all(-1) & held[:, 1:]
    assert 0.8 < same.sum() / held.sum() < 0.95  # held for 8 steps on average
    begun = [[(x, len([*again])) for x, again in groupby(one)][:-1] for one in acted.tolist()]
    steps = [count for one in begun for x, count in one if x != own.tolist()]
    assert (min(steps), max(steps)) == (1, 15)
    assert 0.9 < np.abs(acted).max() < 1.0


def test_a_limit_of_its_acceleration_keeps_it_from_shaking_an_arm() -> None:
    config = ExplorationConfig(sigma=1.0, held=0.3, acceleration=2.0)
    made, own = ExplorationNoise(config, 0.1, 3, actions=6), np.zeros(6, np.float32)
    for episode in range(20):
        acted = np.array([made.explore(own, episode) for _ in range(100)], np.float64)
        assert np.abs(np.diff(acted, axis=0, prepend=0.0)).max() < 0.2 + 1e-6
        assert np.abs(acted).max() > 0.7  # it still explores
