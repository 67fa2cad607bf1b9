"""Exploration noise: an Ornstein–Uhlenbeck process (paper, appendix; Lillicrap et al. 2015)."""

from __future__ import annotations

import math

import numpy as np

from pa_ros.acting.config import ExplorationConfig
from pa_ros.core.experience import Float64

NOISE_STREAM = 1  # of default_rng([seed, stream, episode])


class OrnsteinUhlenbeck:
    """dx = −θ x dt + noise, sampled exactly once per control step; one process per episode.

    The paper gives σ = 0.3 and θ = 1.0 without units. σ is read as the standard deviation of x
    itself, in shares of full speed, and θ as a rate per second. x starts in its stationary
    distribution. The stream is made anew for each episode, so resuming needs no hidden value.
    """

    def __init__(
        self,
        config: ExplorationConfig,
        control_period_s: float,
        seed: int,
        actions: int,
        episode: int,
    ) -> None:
        self.episode, self._actions = episode, actions
        self._rng = np.random.default_rng([seed, NOISE_STREAM, episode])
        self._decay = math.exp(-config.damping * control_period_s)
        self._scale = config.sigma * math.sqrt(1 - self._decay**2)
        self._x = config.sigma * self._rng.standard_normal(actions)

    def sample(self) -> Float64:
        """Return x now, [J], and let one control step pass."""
        now = self._x
        self._x = self._decay * now + self._scale * self._rng.standard_normal(self._actions)
        return now


class ExplorationNoise:
    """One agent's noise: each episode has its own process."""

    def __init__(
        self, config: ExplorationConfig, control_period_s: float, seed: int, actions: int
    ) -> None:
        """`actions`: elements of an action, J."""
        self._given = config, control_period_s, seed, actions
        self._process: OrnsteinUhlenbeck | None = None

    def sample(self, episode: int) -> Float64:
        """The noise of the episode's next control step, [J]."""
        if self._process is None or self._process.episode != episode:
            self._process = OrnsteinUhlenbeck(*self._given, episode)
        return self._process.sample()
