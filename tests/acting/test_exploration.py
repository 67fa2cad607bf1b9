"""Exploration noise: its moments, and that an episode's noise is the episode's own."""

from __future__ import annotations

import math

import numpy as np

from pa_ros.acting.config import ExplorationConfig
from pa_ros.acting.exploration import ExplorationNoise, OrnsteinUhlenbeck


def series(config: ExplorationConfig, episodes: int, steps: int) -> np.ndarray:
    """Noise of many episodes, [E, T, 6]."""
    runs = [OrnsteinUhlenbeck(config, 0.1, 0, 6, episode) for episode in range(episodes)]
    return np.array([[run.sample() for _ in range(steps)] for run in runs])


def test_moments() -> None:
    """Zero mean, the standard deviation promised at every step, correlation e^(−θt)."""
    x = series(ExplorationConfig(), 2000, 11)
    np.testing.assert_allclose(x.mean((0, 2)), 0.0, atol=0.01)
    np.testing.assert_allclose(x.std((0, 2)), 0.3, rtol=0.03)
    correlation = (x[:, 0] * x[:, 10]).mean() / (x[:, 0].std() * x[:, 10].std())
    assert abs(correlation - math.exp(-1.0)) < 0.03


def test_an_episode_has_its_own_stream() -> None:
    config = ExplorationConfig()
    a, b, c = (OrnsteinUhlenbeck(config, 0.1, 3, 6, episode) for episode in (7, 7, 8))
    first = [a.sample() for _ in range(5)]
    np.testing.assert_array_equal(first, [b.sample() for _ in range(5)])
    assert not np.array_equal(first[0], c.sample())
    assert not np.array_equal(first[0], OrnsteinUhlenbeck(config, 0.1, 4, 6, 7).sample())


def test_noise_follows_the_episode_and_the_control_period() -> None:
    config, noise = ExplorationConfig(), ExplorationNoise(ExplorationConfig(), 0.1, 3, 6)
    for episode in (0, 5):
        process = OrnsteinUhlenbeck(config, 0.1, 3, 6, episode)
        for _ in range(3):
            np.testing.assert_array_equal(noise.sample(episode), process.sample())
    quick, slow = (OrnsteinUhlenbeck(config, period, 3, 6, 0) for period in (0.1, 1.0))
    np.testing.assert_array_equal(quick.sample(), slow.sample())  # where it starts
    assert not np.array_equal(quick.sample(), slow.sample())
