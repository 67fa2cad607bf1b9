"""Joint velocities that are safe for a real arm, from actions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pa_ros.core.experience import Float32, Float64


class VelocityRamp:
    """Joint velocities, rad/s [J], within speed limits and with limited acceleration."""

    def __init__(self, speed_limits: Sequence[float], acceleration: float) -> None:
        """`acceleration`: rad/s², of every joint; 0: no limit. It begins at rest."""
        self._speeds = np.array(speed_limits)
        self._acceleration = acceleration or np.inf
        self.velocity: Float64 = np.zeros(len(self._speeds))

    @property
    def moving(self) -> bool:
        """Whether any velocity is not zero."""
        return bool(self.velocity.any())

    def towards(self, action: Float32 | Float64, period_s: float) -> Float64:
        """The velocities one period later, on the way to an action: shares [J] of the limits."""
        target = action * self._speeds
        most = self._acceleration * period_s
        self.velocity = self.velocity + np.clip(target - self.velocity, -most, most)
        return self.velocity.copy()
