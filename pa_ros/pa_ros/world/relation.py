"""What a relation between two objects is, the registry, and this project's relations.

Parser, verifier, relabeling, networks, pictures and the scripted reference use what is registered
here. A custom relation is one file that calls `register`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import isfinite, pi, radians, tan
from typing import Any, Literal

import numpy as np

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float64
from pa_ros.core.extensions import guarded
from pa_ros.core.registry import Registry
from pa_ros.language.syntax import HAND, HOLD, ON
from pa_ros.world.poses import IDENTITY, POSE_WIDTH, in_base, in_hand

Measure = Callable[..., Float64]
Place = Callable[[Float64, Float64, float], Float64]


def _fits(measures: Any, first: Float64, second: Float64) -> bool:
    """Whether there is a number for each pair of poses."""
    shape = np.broadcast_shapes(first.shape[:-1], second.shape[:-1])
    real = isinstance(measures, (np.ndarray, np.generic)) and measures.dtype.kind in "iuf"
    return real and measures.shape == shape and not np.isnan(measures).any()


@dataclass(frozen=True)
class Relation:
    """A relation of the program language, NAME(HAND, e), with its meaning.

    `measure(hand, objects)` is a pure function of poses, [..., 7] each and broadcast: x y z (m) and
    quaternion xyzw, in `frame`. It returns numbers [...] in `unit`, never NaN, with the same bits
    for one state as for many. The relation holds where they are at most the threshold. In
    NAME(e1, e2) an object of e1 has the part of the hand, and `between` replaces the threshold.

    Of a hand that can hold, a pose has an eighth number: 1 where it holds something, else 0. With
    `of_grip`, `measure(first, objects, hand)` also gets the hand, whatever the first is.

    `goal(hand, object, threshold)` is the place [3] to which the scripted reference moves the hand.
    `outline(hand, object, threshold)` is a line [M, 2] for pictures from above, around the places
    where the relation holds. Both get places in the base's frame (m).
    """

    name: str
    meaning: str  # in words: "the hand is ..."
    measure: Measure
    unit: str
    threshold: float  # the default of an arena
    goal: Place
    outline: Place
    frame: Literal["hand", "base"] = "base"
    between: float | None = None  # the threshold between two objects; None: the arena's
    of_grip: bool = False
    rests_m: float | None = None  # how far the target is below what rests on it; None: beside it

    def __post_init__(self) -> None:
        """ConfigError unless threshold and functions are as the class describes."""
        self.check(self.threshold)
        hand, objects = IDENTITY, np.stack([IDENTITY] * 3)
        objects[:, :3] = (0.3, 0.1, -0.2), (-0.1, 0.2, 0.1), (0.2, -0.3, 0.4)
        one = hand[:3], objects[0, :3], self.threshold
        grip = [hand] * self.of_grip
        for what, numbers, shape in (
            ("measure", self.measure(hand, objects, *grip), (3,)),
            ("measure", self.measure(hand[None, None], np.stack([objects] * 2), *grip), (2, 3)),
            ("goal", self.goal(*one), (3,)),
            ("outline", self.outline(*one)[:1], (1, 2)),
        ):
            if np.shape(numbers) != shape or np.isnan(numbers).any():
                raise ConfigError(
                    f"relation {self.name}: {what}: expected numbers {list(shape)} without NaN, "
                    f"got {numbers!r}"
                )
        expected = "a number for each pair of poses"
        measure = guarded(f"relation {self.name}: measure", self.measure, _fits, expected)
        object.__setattr__(self, "measure", measure)

    def check(self, threshold: float) -> None:
        """Raise ConfigError unless a threshold is positive and finite."""
        if not (isfinite(threshold) and threshold > 0):
            raise ConfigError(
                f"threshold of {self.name}: expected a positive number ({self.unit}), "
                f"got {threshold}"
            )

    def measures(
        self, objects: Float64, hand_pose: Float64 | None, moved: Float64 | None = None
    ) -> Float64:
        """The measure [...] of each object, from poses [..., 7] in the hand's frame.

        `moved` [..., 7], in the same frame, is what is related to them; by default the hand.
        `hand_pose` [..., 7] is the hand's in the base's frame. Only relations of that frame need
        it; they raise ConfigError if it is None.
        """
        if self.frame == "hand":
            return self.measure(IDENTITY, objects if moved is None else in_hand(moved, objects))
        if hand_pose is None:
            raise ConfigError(f"relation {self.name}: expected the hand's pose, got none")
        first = hand_pose if moved is None else in_base(hand_pose, moved)
        grip = [hand_pose] * self.of_grip
        return self.measure(first, in_base(hand_pose, objects), *grip)

    def of_places(self, hand: Float64, objects: Float64) -> Float64:
        """The measure of upright objects at places [..., 3] for an upright hand at a place [3]."""
        poses = np.broadcast_to(IDENTITY, (*objects.shape[:-1], POSE_WIDTH)).copy()
        poses[..., :3] = objects - hand
        return self.measures(poses, np.concatenate([hand, IDENTITY[3:]]))


BLOCK_M = 0.06  # edge of a cube and height of a cylinder: how far apart stacked ones are
RELATIONS: Registry[Relation] = Registry("relation")


def register(relation: Relation) -> Relation:
    """Register a relation by its name; ConfigError if another one has that name."""
    return RELATIONS.register(relation.name, relation)


def programs_in(goal: str) -> list[tuple[str, bool]]:
    """The relation of each program of a goal, in the order of its text, and whether the program
    moves the hand."""
    found = re.findall(r"(\w+)\s*\(\s*(?=(\w+))", goal)
    return [(name, first == HAND.name) for name, first in found if name in RELATIONS]


def measured(goal: str, value: float, stage: int = 0) -> str:
    """A measure with the unit of the relation that is pursued at a stage of a goal: "0.05 m"."""
    programs = programs_in(goal)
    unit = RELATIONS[programs[stage][0]].unit if stage < len(programs) else ""
    return f"{value:.2f} {unit}".rstrip()


def at_stage(goal: str, stage: int) -> str:
    """Where a goal of several programs is: "stage 2 of 3"; empty for a single program."""
    count = len(programs_in(goal))
    return f"stage {stage + 1} of {count}" if count > 1 else ""


def circle(center: Float64, radius: float) -> Float64:
    """A circle around a place, as a line [M, 2]."""
    return arc(center, radius, 0.0, np.pi)


def arc(center: Float64, radius: float, direction: float, half_angle: float) -> Float64:
    """A part of a circle around `direction` (rad from the x axis), as a line [M, 2]."""
    angles = direction + np.linspace(-half_angle, half_angle, 49)
    return center[:2] + radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


# The relations of this project: NEAR, ABOVE, and the four sides of an object. The sides are seen
# from the base: the far side of an object is BEHIND it, and greater azimuths are to the left.

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
        between=0.10,  # where two blocks of 0.06 m nearly touch
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
            unit="of the limits",
            threshold=1.0,
            goal=partial(_beside, _side),
            outline=partial(_sector, _side),
        )
    )

# The relations of a hand that holds. A place is as high as a block would be under what rests on it,
# so that blocks on places and blocks on blocks look alike.

GRIP_M = 0.105  # from the hand to the middle of a block that it holds
HELD_M = 0.04  # and how much farther or nearer it may be
NOT_HELD_M = 1.0  # added to the measure of HOLD while the hand holds nothing
HELD_LIMITS = 2.0  # added to the measure of ON while the hand holds what is to rest
ON_BESIDE_M, ON_HEIGHT_M = 0.03, 0.01  # from the middle of what something rests on


def _from_grip(hand: Float64, objects: Float64) -> Float64:
    """How far objects are from where the hand holds one; m."""
    i, j, k, w = (hand[..., n] for n in range(3, 7))
    axis = 2 * (i * k + j * w), 2 * (j * k - i * w), 1 - 2 * (i * i + j * j)  # the hand's own z
    x, y, z = (objects[..., n] - hand[..., n] - GRIP_M * axis[n] for n in range(3))
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def _held(hand: Float64, objects: Float64) -> Float64:
    """The distance from where the hand holds something, and more while it holds nothing."""
    holds = hand[..., POSE_WIDTH] if hand.shape[-1] > POSE_WIDTH else 0.0
    return np.asarray(_from_grip(hand, objects) + NOT_HELD_M * (1.0 - holds))


def _rests(first: Float64, objects: Float64, hand: Float64) -> Float64:
    """How far `first` is from resting on objects, as shares of the limits, the greatest one; a
    block that the hand holds rests on nothing."""
    x, y, z = (first[..., n] - objects[..., n] for n in range(3))
    beside = np.sqrt(x * x + y * y) / ON_BESIDE_M
    height = np.abs(z - BLOCK_M) / ON_HEIGHT_M
    held = _held(hand, first) <= HELD_M
    return np.asarray(np.maximum(beside, height) + np.where(held, HELD_LIMITS, 0.0))


register(
    Relation(
        name=HOLD,
        meaning="holding it",
        measure=_held,
        unit="m",
        threshold=HELD_M,
        goal=lambda hand, target, threshold: target + np.array([0.0, 0.0, GRIP_M]),
        outline=lambda hand, target, threshold: circle(hand, threshold),
    )
)
register(
    Relation(
        name=ON,
        meaning="resting on it: released, at its height and over its middle",
        measure=_rests,
        unit="of the limits",
        threshold=1.0,
        goal=lambda hand, target, threshold: target + np.array([0.0, 0.0, BLOCK_M]),
        outline=lambda hand, target, threshold: circle(target, threshold * ON_BESIDE_M),
        of_grip=True,
        rests_m=BLOCK_M,
    )
)
