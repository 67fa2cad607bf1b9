"""What a relation between the hand and an object is, and those that are known by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import isfinite
from typing import Literal

import numpy as np

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float64
from pa_ros.core.registry import Registry
from pa_ros.world.relations.frames import IDENTITY, POSE, in_base

Measure = Callable[[Float64, Float64], Float64]
Place = Callable[[Float64, Float64, float], Float64]


@dataclass(frozen=True)
class Relation:
    """A node of the program language, NAME(HAND, e), and all that it means.

    `measure(hand, objects)` is a pure function of poses, [..., 7] each and broadcast: x y z (m) and
    the quaternion xyzw, in `frame`. It returns numbers [...] in `unit`, never NaN and of the same
    bits for one state as for many; the relation holds where they are at most the threshold.

    `goal(hand, object, threshold)` is where the scripted reference sends the hand, [3], and
    `outline(hand, object, threshold)` a line that pictures from above draw, [M, 2]: where the
    relation would hold, in one way or the other. Both are given places in the base's frame (m).
    """

    name: str
    meaning: str  # in words: "the hand is ..."
    measure: Measure
    unit: str
    threshold: float  # unless the arena sets another
    goal: Place
    outline: Place
    frame: Literal["hand", "base"] = "base"
    arity: int = 2  # the hand, and objects that one expression describes

    def __post_init__(self) -> None:
        if not (self.name.isascii() and self.name.isidentifier() and self.name.isupper()):
            raise ConfigError(f"relation: expected an upper-case ASCII name, got {self.name!r}")
        if self.frame not in ("hand", "base"):
            raise ConfigError(
                f"relation {self.name}: frame: expected hand or base, got {self.frame!r}"
            )
        if self.arity != 2:
            raise ConfigError(
                f"relation {self.name}: arity: expected 2, {self.name}(HAND, e), got {self.arity}"
            )
        self.check(self.threshold)
        hand, places = IDENTITY, np.stack([IDENTITY] * 3)
        places[:, :3] = (0.3, 0.1, -0.2), (-0.1, 0.2, 0.1), (0.2, -0.3, 0.4)
        self._probe("measure", (3,), lambda: self.measure(hand, places))
        hands, scenes = np.stack([[hand]] * 2), np.stack([places] * 2)
        self._probe("measure", (2, 3), lambda: self.measure(hands, scenes))
        for what, shape, call in (("goal", (3,), self.goal), ("outline", (None, 2), self.outline)):
            self._probe(what, shape, partial(call, hand[:3], places[0, :3], self.threshold))

    def _probe(self, what: str, shape: tuple[int | None, ...], call: Callable[[], object]) -> None:
        """ConfigError unless the call gives numbers of a shape, none of them NaN."""
        where = f"relation {self.name}: {what}: expected numbers {list(shape)}, none of them NaN"
        try:
            given = call()
            numbers = np.asarray(given, np.float64)
        except Exception as error:  # whatever code of others raises
            raise ConfigError(f"{where}, got {type(error).__name__}: {error}") from error
        fits = isinstance(given, np.ndarray) and len(shape) == given.ndim
        fits = fits and all(n in (None, m) for n, m in zip(shape, numbers.shape, strict=True))
        if not fits or np.isnan(numbers).any():
            raise ConfigError(f"{where}, got {given!r}")

    def check(self, threshold: float) -> None:
        """Raise ConfigError for a threshold that cannot be."""
        if not (isfinite(threshold) and threshold > 0):
            raise ConfigError(
                f"threshold of {self.name}: expected a positive number ({self.unit}), "
                f"got {threshold}"
            )

    def measures(self, objects: Float64, hand_pose: Float64 | None) -> Float64:
        """The measure of each object, [...], of poses in the hand's frame, [..., 7].

        `hand_pose` [..., 7] is the hand's in the base's frame, which only relations of that frame
        need: ConfigError where it is None.
        """
        if self.frame == "hand":
            return self.measure(IDENTITY, objects)
        if hand_pose is None:
            raise ConfigError(f"relation {self.name}: expected the hand's pose, got none")
        return self.measure(hand_pose, in_base(hand_pose, objects))

    def of_places(self, hand: Float64, objects: Float64) -> Float64:
        """The measure of objects at places [..., 3] for a hand at one, [3], none of them turned."""
        poses = np.broadcast_to(IDENTITY, (*objects.shape[:-1], POSE)).copy()
        poses[..., :3] = objects - hand
        return self.measures(poses, np.concatenate([hand, IDENTITY[3:]]))


RELATIONS: Registry[Relation] = Registry("relation")


def register(relation: Relation) -> Relation:
    """Make a relation known by its name; ConfigError if another one has it."""
    return RELATIONS.register(relation.name, relation)


def circle(center: Float64, radius: float) -> Float64:
    """A line around a place, [M, 2]."""
    return arc(center, radius, 0.0, np.pi)


def arc(center: Float64, radius: float, direction: float, half_angle: float) -> Float64:
    """Part of a circle about `direction` (rad from the x axis), [M, 2]."""
    angles = direction + np.linspace(-half_angle, half_angle, 49)
    return center[:2] + radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
