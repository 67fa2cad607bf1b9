"""Velocities within the limits that change no faster than allowed."""

import numpy as np
import pytest

from pa_ros.world.velocity import VelocityRamp


def test_a_ramp_is_no_steeper_than_allowed_and_ends_at_the_limits():
    ramp, speeds = VelocityRamp((1.0, 2.0, 0.5), acceleration=2.0), []
    for _ in range(12):
        speeds.append(ramp.towards(np.array([1.0, -1.0, 0.1], np.float32), 0.1))
    steps = np.diff([np.zeros(3), *speeds], axis=0)
    assert np.abs(steps).max() <= 0.2 + 1e-9 and ramp.moving
    assert speeds[0] == pytest.approx([0.2, -0.2, 0.05])
    assert speeds[-1] == pytest.approx([1.0, -2.0, 0.05])
    for _ in range(11):
        ramp.towards(np.zeros(3, np.float32), 0.1)
    assert not ramp.moving


def test_without_a_limit_it_follows_at_once():
    ramp = VelocityRamp((1.5,) * 7, acceleration=0.0)
    assert ramp.towards(np.full(7, -1.0, np.float32), 0.1) == pytest.approx([-1.5] * 7)
