"""ABOVE: over an object, within an upright cone that stands on its center."""

from __future__ import annotations

from math import radians, tan

import numpy as np

from pa_ros.core.experience import Float64
from pa_ros.world.relations.relation import Relation, circle, register

HEIGHT_M = 0.20  # at which the script holds the hand over the target's center


def _angle(hand: Float64, objects: Float64) -> Float64:
    """Between the vertical and the line from the object to the hand, 0 to π."""
    x, y, z = (hand[..., i] - objects[..., i] for i in range(3))
    return np.asarray(np.arctan2(np.sqrt(x * x + y * y), z))


def _over_it(hand: Float64, target: Float64, threshold: float) -> Float64:
    return np.asarray(target + np.array([0.0, 0.0, HEIGHT_M]))


def _cone_at_the_hand(hand: Float64, target: Float64, threshold: float) -> Float64:
    """The cone's cross-section at the hand's height."""
    return circle(target, max(hand[2] - target[2], 0.0) * tan(min(threshold, radians(89.0))))


ABOVE = register(
    Relation(
        name="ABOVE",
        meaning="over it: the line from its center to the hand is that near the vertical",
        measure=_angle,
        unit="rad",
        threshold=radians(20.0),
        goal=_over_it,
        outline=_cone_at_the_hand,
    )
)
