"""Joint velocities that are safe for a real arm, and where they have moved it."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import inf

import numpy as np

from pa_ros.core.experience import Float32, Float64

TINY = 1e-9  # rad/s
RECENT = 20  # velocities sent, in about a second


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
        """The velocities one period later, on the way to an action: shares [J] of the limits.

        All joints get there at the same time, so an arm that stops keeps its direction.
        """
        change = action * self._speeds - self.velocity
        share = self._acceleration * max(period_s, TINY) / max(np.abs(change).max(), TINY)
        self.velocity = self.velocity + min(share, 1.0) * change
        return self.velocity.copy()


class DeadReckoning:
    """Where joints are now: the last good measurement, moved on by what was sent since; rad [J].

    While the arm is commanded, the estimate moves from one measurement to the next no faster than
    the joints can turn, so one wrong measurement makes no jump.
    """

    def __init__(self, speed_limits: Sequence[float], lasts_s: float) -> None:
        """`speed_limits`: rad/s; `lasts_s`: how long the arm follows a command that stays alone."""
        self._speeds, self._lasts_s = np.array(speed_limits), lasts_s
        self.position: Float64 = np.zeros(len(self._speeds))
        self._before = self.position  # after the last measurement
        self._at_s, self._measured_s, self._sent_s = inf, -inf, -inf
        self._sent: deque[tuple[float, Float64]] = deque(maxlen=RECENT)  # when, and velocities

    def measured(self, position: Float64, age_s: float, now_s: float) -> None:
        """Take a measurement [J] that passed all checks, made `age_s` ago."""
        self.move(now_s)
        commanded = now_s - self._sent_s <= self._lasts_s
        reach = self._speeds * (now_s - self._measured_s if commanded else inf)
        ahead = position + self._moved(now_s - age_s, now_s)
        # A driver may count whole turns of a joint anew.
        turns = 2 * np.pi * np.round((ahead - self.position) / (2 * np.pi))
        before = self._before + turns
        self.position = self._before = np.clip(ahead, before - reach, before + reach)
        self._measured_s = now_s

    @property
    def velocity(self) -> Float64:
        """What was sent last, rad/s [J]."""
        return self._sent[-1][1] if self._sent else np.zeros(len(self._speeds))

    def sent(self, velocity: Float64, now_s: float) -> None:
        """Note the velocities [J] (rad/s) that the arm has from now on."""
        self.move(now_s)
        self._sent_s = now_s
        self._sent.append((now_s, velocity.copy()))

    def move(self, now_s: float) -> None:
        """Move on by what was sent last."""
        self.position = self.position + self._moved(self._at_s, now_s)
        self._at_s = now_s

    def _moved(self, since_s: float, now_s: float) -> Float64:
        """How far the arm moved in a time, by what was sent before and in it; rad [J]."""
        moved, until_s = np.zeros(len(self._speeds)), now_s
        for sent_s, velocity in reversed(self._sent):
            lasted_s = min(until_s, sent_s + self._lasts_s) - max(sent_s, since_s)
            moved += velocity * max(lasted_s, 0.0)
            until_s = min(until_s, sent_s)
        return moved
