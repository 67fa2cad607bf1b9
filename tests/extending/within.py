"""A custom relation: the hand is at a distance of 0.30 m from an object.

`pa_ros train --extension tests/extending/within.py --relations NEAR WITHIN` learns with it.
"""

import numpy as np

from pa_ros.core.experience import Float64
from pa_ros.world.relation import Relation, circle, register

RADIUS_M = 0.30


def off_the_ring(hand: Float64, objects: Float64) -> Float64:
    """Distance of the hand from a sphere around each object; poses [..., 7] in one frame."""
    x, y, z = (objects[..., i] - hand[..., i] for i in range(3))
    return np.asarray(np.abs(np.sqrt(x * x + y * y + z * z) - RADIUS_M))


def above_it(hand: Float64, target: Float64, threshold: float) -> Float64:
    """The place to which the scripted reference moves the hand."""
    return np.asarray(target + np.array([0.0, 0.0, RADIUS_M]))


def around_it(hand: Float64, target: Float64, threshold: float) -> Float64:
    """The line that pictures draw."""
    return circle(target, RADIUS_M)


WITHIN = register(
    Relation(
        name="WITHIN",
        meaning="at a distance of 0.30 m from its center, up to the threshold",
        measure=off_the_ring,
        unit="m",
        threshold=0.03,
        goal=above_it,
        outline=around_it,
        frame="hand",  # a distance is the same in every frame, so agents do not need the pose
    )
)
