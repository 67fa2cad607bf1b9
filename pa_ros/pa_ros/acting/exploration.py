"""Exploration noise: an Ornstein–Uhlenbeck process (paper, appendix; Lillicrap et al. 2015)."""

from __future__ import annotations

import math

import numpy as np

from pa_ros.acting.config import ExplorationConfig
from pa_ros.core.experience import Float32, Float64

NOISE_STREAM = 1  # of default_rng([seed, stream, episode])


class ExplorationNoise:
    """dx = −θ x dt + noise, sampled exactly once per control step; one process per episode.

    The paper gives σ = 0.3 and θ = 1.0 without units. σ is read as the standard deviation of x
    itself, in shares of full speed, and θ as a rate per second. x starts in its stationary
    distribution. The stream is made anew for each episode, so resuming needs no hidden value.
    """

    def __init__(
        self, config: ExplorationConfig, control_period_s: float, seed: int, actions: int
    ) -> None:
        """`actions`: elements of an action, J."""
        self._sigma, self._seed, self._actions = config.sigma, seed, actions
        self._held_steps, self._begins_to_hold = config.held_steps, config.held / config.held_steps
        self._decay = math.exp(-config.damping * control_period_s)
        self._scale = config.sigma * math.sqrt(1 - self._decay**2)
        self._most = config.acceleration * control_period_s or math.inf
        self._begin(episode=0)

    def _begin(self, episode: int) -> None:
        self._episode = episode
        self._rng = np.random.default_rng([self._seed, NOISE_STREAM, episode])
        self._x = self._sigma * self._rng.standard_normal(self._actions)
        self._before = np.zeros(self._actions)  # of the noise, at the step before
        self._held, self._left = self._x, 0  # a uniform action, and for how many steps it is held

    def explore(self, action: Float32, episode: int) -> Float32:
        """The action in place of the policy's at the next control step, in [-1, 1]: [J]."""
        noisy = action + self.sample(episode)
        if self._left == 0 and self._begins_to_hold:
            if self._rng.random() < self._begins_to_hold:
                self._left = int(self._rng.integers(1, 2 * self._held_steps))
                self._held = self._rng.uniform(-1.0, 1.0, self._actions)
        if self._left:
            self._left -= 1
            noisy = self._held
        if self._most < math.inf:
            change = np.clip(noisy - action - self._before, -self._most, self._most)
            self._before = self._before + change
            noisy = action + self._before
        return np.clip(noisy, -1.0, 1.0).astype(np.float32)

    def sample(self, episode: int) -> Float64:
        """Advance the process by one control step; x, [J], before it."""
        if episode != self._episode:
            self._begin(episode)
        now = self._x
        self._x = self._decay * now + self._scale * self._rng.standard_normal(self._actions)
        return now
