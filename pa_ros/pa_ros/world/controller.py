"""Velocities of the hand as an action space: from them to velocities of the joints.

The arm is data, so that an agent needs no simulator, and a real arm's own Cartesian controller can
take the place of this one. Joint commands are what goes to the arm either way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from math import cos, hypot, sin
from typing import Any, ClassVar

import numpy as np

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64

AXES = 3  # of an action: outward, to the left and up, seen from the base


@dataclass(frozen=True)
class Frame:
    """A frame in its parent's frame, which a joint then turns about its own z axis."""

    position: tuple[float, ...]  # m
    rotation: tuple[float, ...]  # matrix, row by row
    zero: float | None  # rad, the joint's angle at which the frame is as above; None: no joint
    lower: float = 0.0  # rad, the joint's working range
    upper: float = 0.0
    turns_freely: bool = False  # has no limits
    max_speed: float = 0.0  # rad/s

    def __post_init__(self) -> None:
        numbers = (*self.position, *self.rotation, self.lower, self.upper, self.max_speed)
        if len(numbers) != 15 or not np.isfinite(np.array(numbers, np.float64)).all():
            raise ConfigError(f"controller: expected finite numbers of a link, got {self}")
        if self.zero is not None and not self.max_speed > 0:
            raise ConfigError(f"controller: expected a positive speed of a joint, got {self}")

    @cached_property
    def origin(self) -> Float64:
        """The position, [3]."""
        return np.array(self.position)

    @cached_property
    def matrix(self) -> Float64:
        """The rotation, [3, 3]."""
        return np.array(self.rotation).reshape(3, 3)


@dataclass(frozen=True)
class HandController:
    """Moves the hand at a wanted velocity and keeps it pointing down, by damped least squares.

    An action [3] in [-1, 1] is the hand's velocity away from the base's axis, about it (to the
    left) and up, as parts of `hand_speed`.
    """

    links: tuple[Frame, ...]  # from the base to the hand
    hand_speed: float  # m/s
    period_s: float  # of a command

    # The space that the hand does not leave: m from the base's axis, and above the table. Its
    # lowest height is that at which it pushes blocks.
    RADII: ClassVar[tuple[float, float]] = (0.18, 0.66)
    HEIGHTS: ClassVar[tuple[float, float]] = (0.08, 0.40)
    UPRIGHT_RATE: ClassVar[float] = 3.0  # 1/s at which the hand turns back to pointing down
    UPRIGHT_WEIGHT: ClassVar[float] = 0.2  # m: how much turning counts beside moving
    DAMPING: ClassVar[float] = 0.03  # m
    SLACK_RAD: ClassVar[float] = 0.02  # a joint this close to its limit is not moved further

    @cached_property
    def joints(self) -> tuple[Frame, ...]:
        """The links that joints turn."""
        return tuple(link for link in self.links if link.zero is not None)

    @cached_property
    def speed_limits(self) -> Float64:
        """Of the joints, rad/s [J]."""
        return np.array([link.max_speed for link in self.joints])

    @cached_property
    def ranges(self) -> tuple[Float64, Float64]:
        """Lower and upper ends of the joints' working ranges, rad [J] each; infinite for a joint
        that turns freely."""
        ends = [(-np.inf, np.inf) if j.turns_freely else (j.lower, j.upper) for j in self.joints]
        lower, upper = np.array(ends).T
        return lower, upper

    def hand(self, joint_position: Sequence[float] | Float64) -> tuple[Float64, Float64, Float64]:
        """The hand's position [3] and z axis [3] in the base's frame, and the Jacobian [6, J] of
        its position (m/rad) and orientation."""
        angles = iter(joint_position)
        place, turn = np.zeros(3), np.eye(3)
        places, axes = [], []
        for link in self.links:
            place = place + turn @ link.origin
            turn = turn @ link.matrix
            if link.zero is not None:
                places.append(place)
                axes.append(turn[:, 2])
                angle = float(next(angles)) - link.zero
                c, s = cos(angle), sin(angle)
                turn = turn @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        along = np.array(axes)
        moves = _cross(along, place - np.array(places))
        return place, turn[:, 2], np.concatenate([moves, along], 1).T

    def joint_action(self, action: Float32, joint_position: Float64) -> Float32:
        """Joint velocities, as parts of the speed limits, that move the hand as `action` says."""
        place, axis, jacobian = self.hand(joint_position)
        # On the base's axis the hand has no azimuth, so close to it all motions become smaller.
        radius = max(hypot(place[0], place[1]), 0.05)
        c, s = place[0] / radius, place[1] / radius
        out, left, up = np.clip(action.astype(np.float64), -1.0, 1.0) * self.hand_speed
        (near, far), (low, high), period = self.RADII, self.HEIGHTS, self.period_s
        out = min(max(out, (near - radius) / period), (far - radius) / period)
        up = min(max(up, (low - place[2]) / period), (high - place[2]) / period)
        moving = np.array([c * out - s * left, s * out + c * left, up])
        velocity = self.solve(moving, axis, jacobian, joint_position)
        # All joints are slowed alike, so that the hand keeps its direction.
        excess = max(1.0, float(np.max(np.abs(velocity) / self.speed_limits)))
        return (velocity / excess / self.speed_limits).astype(np.float32)

    def solve(
        self, moving: Float64, axis: Float64, jacobian: Float64, joint_position: Float64
    ) -> Float64:
        """Joint velocities (rad/s, [J], not limited) for the hand's velocity [3] (m/s)."""
        upright = np.array([-axis[1], axis[0]]) * self.UPRIGHT_RATE  # axis × down
        rates = np.concatenate([moving, self.UPRIGHT_WEIGHT * upright])
        rows = np.concatenate([jacobian[:3], self.UPRIGHT_WEIGHT * jacobian[3:5]])
        lower, upper = self.ranges
        damping = self.DAMPING**2 * np.eye(len(rows))
        for _ in range(2):  # the second time without the joints at their limits
            velocity = rows.T @ np.linalg.solve(rows @ rows.T + damping, rates)
            above = (velocity > 0) & (joint_position > upper - self.SLACK_RAD)
            below = (velocity < 0) & (joint_position < lower + self.SLACK_RAD)
            free = ~(above | below)
            rows = rows * free
        return np.asarray(velocity * free)

    def to_data(self) -> dict[str, Any]:
        """As data for JSON."""
        return asdict(self)

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> HandController:
        """The inverse of `to_data`."""
        links = tuple(
            Frame(**{**one, "position": tuple(one["position"]), "rotation": tuple(one["rotation"])})
            for one in data["links"]
        )
        return cls(links, float(data["hand_speed"]), float(data["period_s"]))


def _cross(a: Float64, b: Float64) -> Float64:
    """Cross products of rows, [J, 3]; several times faster than np.cross."""
    (u, v, w), (x, y, z) = a.T, b.T
    return np.stack([v * z - w * y, w * x - u * z, u * y - v * x], -1)
