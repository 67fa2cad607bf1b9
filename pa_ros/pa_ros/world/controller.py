"""Velocities of the hand as an action space: from them to velocities of the joints.

The arm is data, so that an agent needs no simulator, and a real arm's own Cartesian controller can
take the place of this one. Joint commands are what goes to the arm either way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from math import atan2, cos, hypot, sin
from typing import Any, ClassVar, NamedTuple

import numpy as np

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64

# Where a hand moves unless its arm says more; at the lowest height it pushes blocks. Lengths in m.
RADII, HEIGHTS = (0.18, 0.66), (0.08, 0.40)
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


class Hand(NamedTuple):
    """Where an arm's hand is, and how its joints move it."""

    place: Float64  # [3], m in the base's frame
    turn: Float64  # [3, 3], its axes as columns
    jacobian: Float64  # [6, J] of its position (m/rad) and orientation

    @property
    def heading(self) -> float:
        """The direction of the hand's x axis, seen from above, less that of the hand itself seen
        from the base: rad in [-π, π]."""
        turned = atan2(self.turn[1, 0], self.turn[0, 0]) - atan2(self.place[1], self.place[0])
        return atan2(sin(turned), cos(turned))


@dataclass(frozen=True)
class HandController:
    """Moves the hand at a wanted velocity, pointing down, by damped least squares.

    An action [3] in [-1, 1] is the hand's velocity away from the base's axis, about it (to the
    left) and up, as parts of `hand_speed`. The hand turns with its direction from the base, so that
    an action always moves it the same way in its own frame.
    """

    links: tuple[Frame, ...]  # from the base to the hand
    hand_speed: float  # m/s
    period_s: float  # of a command
    heading: float  # rad, of the hand (`Hand.heading`), which is kept
    # The space that the hand does not leave: m from the base's axis, and above the table.
    radii: tuple[float, float] = RADII
    heights: tuple[float, float] = HEIGHTS

    TURN_RATE: ClassVar[float] = 3.0  # 1/s at which the hand turns back, down and to its heading
    TURN_WEIGHT: ClassVar[float] = 0.2  # m: how much turning counts beside moving
    HEADING_SPEED: ClassVar[float] = 0.6  # rad/s, at most, at which it turns back to its heading
    DAMPING: ClassVar[float] = 0.03  # m
    SLACK_RAD: ClassVar[float] = 0.02  # a joint this close to its limit is not moved further

    @cached_property
    def joints(self) -> tuple[Frame, ...]:
        """The links that joints turn."""
        return tuple(link for link in self.links if link.zero is not None)

    @cached_property
    def speed_limits(self) -> Float64:
        """Speed limits of the joints, rad/s [J]."""
        return np.array([link.max_speed for link in self.joints])

    @cached_property
    def ranges(self) -> tuple[Float64, Float64]:
        """Lower and upper ends of the joints' working ranges, rad [J] each; infinite for a joint
        that turns freely."""
        ends = [(-np.inf, np.inf) if j.turns_freely else (j.lower, j.upper) for j in self.joints]
        lower, upper = np.array(ends).T
        return lower, upper

    def hand(self, joint_position: Sequence[float] | Float64) -> Hand:
        """The hand at joint positions (rad, [J])."""
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
        return Hand(place, turn, np.concatenate([moves, along], 1).T)

    def joint_action(self, action: Float32, joint_position: Float64) -> Float32:
        """Joint velocities, as parts of the speed limits, that move the hand as `action` says."""
        hand = self.hand(joint_position)
        x, y, z = hand.place.tolist()
        # On the base's axis the hand has no azimuth, so close to it all motions become smaller.
        radius = max(hypot(x, y), 0.05)
        c, s = x / radius, y / radius
        out, left, up = np.clip(action.astype(np.float64), -1.0, 1.0) * self.hand_speed
        (near, far), (low, high), period = self.radii, self.heights, self.period_s
        out = min(max(out, (near - radius) / period), (far - radius) / period)
        up = min(max(up, (low - z) / period), (high - z) / period)
        moving = np.array([c * out - s * left, s * out + c * left, up])
        velocity = self.solve(moving, hand, joint_position)
        # All joints are slowed alike, so that the hand keeps its direction.
        excess = max(1.0, float(np.max(np.abs(velocity) / self.speed_limits)))
        return (velocity / excess / self.speed_limits).astype(np.float32)

    def action_of(self, command: Float32, joint_position: Float64) -> Float32:
        """The action [3] that moves the hand as joint velocities (parts of the speed limits) do."""
        hand = self.hand(joint_position)
        moving = hand.jacobian[:3] @ (command.astype(np.float64) * self.speed_limits)
        x, y, _ = hand.place.tolist()
        radius = max(hypot(x, y), 0.05)
        c, s = x / radius, y / radius
        along = np.array([c * moving[0] + s * moving[1], c * moving[1] - s * moving[0], moving[2]])
        return np.clip(along / self.hand_speed, -1.0, 1.0).astype(np.float32)

    def solve(self, moving: Float64, hand: Hand, joint_position: Float64) -> Float64:
        """Joint velocities (rad/s, [J], not limited) for the hand's velocity [3] (m/s)."""
        (x, y, _), axis = hand.place.tolist(), hand.turn[:, 2]
        error = self.heading - hand.heading
        back = self.TURN_RATE * atan2(sin(error), cos(error))
        back = min(max(back, -self.HEADING_SPEED), self.HEADING_SPEED)
        with_place = (x * moving[1] - y * moving[0]) / max(x * x + y * y, 0.05**2)
        down = np.array([-axis[1], axis[0]]) * self.TURN_RATE  # axis × down
        turning = np.array([*down, with_place + back])
        rates = np.concatenate([moving, self.TURN_WEIGHT * turning])
        rows = np.concatenate([hand.jacobian[:3], self.TURN_WEIGHT * hand.jacobian[3:]])
        lower, upper = self.ranges
        damping = self.DAMPING**2 * np.eye(len(rows))
        for _ in range(2):  # the second time without the joints at their limits
            velocity = rows.T @ np.linalg.solve(rows @ rows.T + damping, rates)
            above = (velocity > 0) & (joint_position > upper - self.SLACK_RAD)
            below = (velocity < 0) & (joint_position < lower + self.SLACK_RAD)
            free = ~(above | below)
            if free.all():
                break
            rows = rows * free
        return np.asarray(velocity * free)

    def to_data(self) -> dict[str, Any]:
        """The same as data for JSON; without the usual space of the hand."""
        usual = {"radii": RADII, "heights": HEIGHTS}
        return {k: v for k, v in asdict(self).items() if usual.get(k) != v}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> HandController:
        """The inverse of `to_data`."""
        links = tuple(
            Frame(**{**one, "position": tuple(one["position"]), "rotation": tuple(one["rotation"])})
            for one in data["links"]
        )
        speed, period, heading = (float(data[k]) for k in ("hand_speed", "period_s", "heading"))
        (near, far), (low, high) = data.get("radii", RADII), data.get("heights", HEIGHTS)
        space = (float(near), float(far)), (float(low), float(high))
        return cls(links, speed, period, heading, *space)


def _cross(a: Float64, b: Float64) -> Float64:
    """Cross products of rows, [J, 3]; several times faster than np.cross."""
    (u, v, w), (x, y, z) = a.T, b.T
    return np.stack([v * z - w * y, w * x - u * z, u * y - v * x], -1)
