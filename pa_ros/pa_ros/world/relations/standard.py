"""The relations of this project: NEAR, ABOVE, and the four sides of an object.

The sides are seen from the base: the far side of an object is BEHIND it, and greater azimuths are
to the left.
"""

from __future__ import annotations

from functools import partial
from math import pi, radians, tan

import numpy as np

from pa_ros.core.experience import Float64
from pa_ros.world.relations.relation import Relation, arc, circle, register

# Where the scripted reference holds the hand, from the target's center.
NEAR_HEIGHT = 0.6  # part of the threshold: 0.12 m of 0.20 m, which is clear of the block
ABOVE_HEIGHT_M = 0.20
SIDE_DISTANCE_M, SIDE_HEIGHT_M = 0.14, 0.12

SIDE_REACH_M = 0.25  # greatest distance from the object's center
SIDE_HALF_ANGLE = pi / 4  # rad; four sectors of twice this angle fill the plane
SIDES = {  # in words, and the middle of the sector in rad from the direction base to object
    "LEFT_OF": ("to the left of it", pi / 2),
    "RIGHT_OF": ("to the right of it", -pi / 2),
    "BEHIND": ("behind it", 0.0),
    "IN_FRONT_OF": ("in front of it", pi),
}


def _distance(hand: Float64, objects: Float64) -> Float64:
    """Distance from the hand, which is the origin of its own frame."""
    squares = objects[..., :3] * objects[..., :3]
    return np.asarray(np.sqrt(squares[..., 0] + squares[..., 1] + squares[..., 2]))


def _angle(hand: Float64, objects: Float64) -> Float64:
    """Angle between the vertical and the line from the object to the hand, 0 to π."""
    x, y, z = (hand[..., i] - objects[..., i] for i in range(3))
    return np.asarray(np.arctan2(np.sqrt(x * x + y * y), z))


def _share_of_sector(side: float, hand: Float64, objects: Float64) -> Float64:
    """Distance and angle as shares of their limits, the greater one; at most 1 in the sector."""
    x, y, z = (hand[..., i] - objects[..., i] for i in range(3))
    distance = np.sqrt(x * x + y * y + z * z)
    middle = np.arctan2(objects[..., 1], objects[..., 0]) + side
    off = np.abs((np.arctan2(y, x) - middle + pi) % (2 * pi) - pi)
    return np.asarray(np.maximum(distance / SIDE_REACH_M, off / SIDE_HALF_ANGLE))


def _beside(side: float, hand: Float64, target: Float64, threshold: float) -> Float64:
    direction = np.arctan2(target[1], target[0]) + side
    x, y = SIDE_DISTANCE_M * np.cos(direction), SIDE_DISTANCE_M * np.sin(direction)
    return np.asarray(target + np.array([x, y, SIDE_HEIGHT_M]))


def _cone_at_hand(hand: Float64, target: Float64, threshold: float) -> Float64:
    """The cross-section of the cone at the height of the hand."""
    return circle(target, max(hand[2] - target[2], 0.0) * tan(min(threshold, radians(89.0))))


def _sector(side: float, hand: Float64, target: Float64, threshold: float) -> Float64:
    direction = float(np.arctan2(target[1], target[0])) + side
    bow = arc(target, threshold * SIDE_REACH_M, direction, min(threshold * SIDE_HALF_ANGLE, pi))
    return np.concatenate([target[None, :2], bow, target[None, :2]])


register(
    Relation(
        name="NEAR",
        meaning="no farther from its center than the threshold (paper, section 3)",
        measure=_distance,
        unit="m",
        threshold=0.20,
        goal=lambda hand, target, threshold: target + np.array([0.0, 0.0, NEAR_HEIGHT * threshold]),
        outline=lambda hand, target, threshold: circle(hand, threshold),
        frame="hand",
    )
)
register(
    Relation(
        name="ABOVE",
        meaning="over it: the line from its center to the hand is that near the vertical",
        measure=_angle,
        unit="rad",
        threshold=radians(20.0),
        goal=lambda hand, target, threshold: target + np.array([0.0, 0.0, ABOVE_HEIGHT_M]),
        outline=_cone_at_hand,
    )
)
for _name, (_where, _side) in SIDES.items():
    register(
        Relation(
            name=_name,
            meaning=f"{_where}, seen from the base: within {SIDE_REACH_M:g} m and 45° of that way",
            measure=partial(_share_of_sector, _side),
            unit="of both limits",
            threshold=1.0,
            goal=partial(_beside, _side),
            outline=partial(_sector, _side),
        )
    )
