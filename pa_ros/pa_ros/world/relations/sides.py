"""LEFT_OF, RIGHT_OF, BEHIND and IN_FRONT_OF: on a side of an object, as it is seen from the base.

Whoever stands at the base and looks at the object has its far side BEHIND it, and greater azimuths
to the left.
"""

from __future__ import annotations

from functools import partial
from math import pi

import numpy as np

from pa_ros.core.experience import Float64
from pa_ros.world.relations.relation import Relation, arc, register

REACH_M = 0.25  # at most this far from the object's center
HALF_ANGLE = pi / 4  # rad of the sector to either side of its middle: four sides fill the plane
BESIDE_M, HEIGHT_M = 0.14, 0.12  # where the script holds the hand, from the object's center

SIDES = {  # what it is called, and the sector's middle: rad from the way that the base looks
    "LEFT_OF": ("to the left of it", pi / 2),
    "RIGHT_OF": ("to the right of it", -pi / 2),
    "BEHIND": ("behind it", 0.0),
    "IN_FRONT_OF": ("in front of it", pi),
}


def _share(side: float, hand: Float64, objects: Float64) -> Float64:
    """The greater share of what is allowed of distance and of angle: at most 1 in the sector."""
    x, y, z = (hand[..., i] - objects[..., i] for i in range(3))
    distance = np.sqrt(x * x + y * y + z * z)
    middle = np.arctan2(objects[..., 1], objects[..., 0]) + side
    off = np.abs((np.arctan2(y, x) - middle + pi) % (2 * pi) - pi)
    return np.asarray(np.maximum(distance / REACH_M, off / HALF_ANGLE))


def _beside_it(side: float, hand: Float64, target: Float64, threshold: float) -> Float64:
    direction = np.arctan2(target[1], target[0]) + side
    x, y = BESIDE_M * np.cos(direction), BESIDE_M * np.sin(direction)
    return np.asarray(target + np.array([x, y, HEIGHT_M]))


def _sector(side: float, hand: Float64, target: Float64, threshold: float) -> Float64:
    direction = float(np.arctan2(target[1], target[0])) + side
    bow = arc(target, threshold * REACH_M, direction, min(threshold * HALF_ANGLE, pi))
    return np.concatenate([target[None, :2], bow, target[None, :2]])


for _name, (_where, _side) in SIDES.items():
    register(
        Relation(
            name=_name,
            meaning=f"{_where}, seen from the base: within {REACH_M:g} m and 45° of that way",
            measure=partial(_share, _side),
            unit="of both limits",
            threshold=1.0,
            goal=partial(_beside_it, _side),
            outline=partial(_sector, _side),
        )
    )
