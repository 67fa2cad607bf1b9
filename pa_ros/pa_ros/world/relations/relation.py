"""What a relation between the hand and an object is, and the registry of relations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Literal

import numpy as np

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float64
from pa_ros.core.extensions import Registry
from pa_ros.world.poses import IDENTITY, POSE_WIDTH, in_base

Measure = Callable[[Float64, Float64], Float64]
Place = Callable[[Float64, Float64, float], Float64]


@dataclass(frozen=True)
class Relation:
    """A relation of the program language, NAME(HAND, e), with its meaning.

    `measure(hand, objects)` is a pure function of poses, [..., 7] each and broadcast: x y z (m) and
    quaternion xyzw, in `frame`. It returns numbers [...] in `unit`, never NaN, with the same bits
    for one state as for many. The relation holds where they are at most the threshold.

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

    def __post_init__(self) -> None:
        """ConfigError unless threshold and functions are as the class describes."""
        self.check(self.threshold)
        hand, objects = IDENTITY, np.stack([IDENTITY] * 3)
        objects[:, :3] = (0.3, 0.1, -0.2), (-0.1, 0.2, 0.1), (0.2, -0.3, 0.4)
        one = hand[:3], objects[0, :3], self.threshold
        for what, numbers, shape in (
            ("measure", self.measure(hand, objects), (3,)),
            ("measure", self.measure(hand[None, None], np.stack([objects] * 2)), (2, 3)),
            ("goal", self.goal(*one), (3,)),
            ("outline", self.outline(*one)[:1], (1, 2)),
        ):
            if np.shape(numbers) != shape or np.isnan(numbers).any():
                raise ConfigError(
                    f"relation {self.name}: {what}: expected numbers {list(shape)} without NaN, "
                    f"got {numbers!r}"
                )

    def check(self, threshold: float) -> None:
        """Raise ConfigError unless a threshold is positive and finite."""
        if not (isfinite(threshold) and threshold > 0):
            raise ConfigError(
                f"threshold of {self.name}: expected a positive number ({self.unit}), "
                f"got {threshold}"
            )

    def measures(self, objects: Float64, hand_pose: Float64 | None) -> Float64:
        """The measure [...] of each object, from poses [..., 7] in the hand's frame.

        `hand_pose` [..., 7] is the hand's in the base's frame. Only relations of that frame need
        it; they raise ConfigError if it is None.
        """
        if self.frame == "hand":
            return self.measure(IDENTITY, objects)
        if hand_pose is None:
            raise ConfigError(f"relation {self.name}: expected the hand's pose, got none")
        return self.measure(hand_pose, in_base(hand_pose, objects))

    def of_places(self, hand: Float64, objects: Float64) -> Float64:
        """The measure of upright objects at places [..., 3] for an upright hand at a place [3]."""
        poses = np.broadcast_to(IDENTITY, (*objects.shape[:-1], POSE_WIDTH)).copy()
        poses[..., :3] = objects - hand
        return self.measures(poses, np.concatenate([hand, IDENTITY[3:]]))


RELATIONS: Registry[Relation] = Registry("relation")


def register(relation: Relation) -> Relation:
    """Register a relation by its name; ConfigError if another one has that name."""
    return RELATIONS.register(relation.name, relation)


def circle(center: Float64, radius: float) -> Float64:
    """A circle around a place, as a line [M, 2]."""
    return arc(center, radius, 0.0, np.pi)


def arc(center: Float64, radius: float, direction: float, half_angle: float) -> Float64:
    """A part of a circle around `direction` (rad from the x axis), as a line [M, 2]."""
    angles = direction + np.linspace(-half_angle, half_angle, 49)
    return center[:2] + radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
