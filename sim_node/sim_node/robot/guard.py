"""Joint velocities that keep the hand in its box and the joints within their limits. No ROS."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pa_ros.core.experience import Float64
from sim_node.robot.settings import Workspace

ROUNDS = 10  # of correcting the faces that are approached too fast
SLOW_S = 0.6  # two command timeouts: one without commands takes the hand half of the way to the box
BRAKE_S = 0.4  # until the arm begins to brake, whatever happens (docs/robot.md)
PLACES = 8  # of the hand that are looked at on its way to rest
STRAY = 0.005  # m that they may be outside the box
TINY = 1e-9  # m/s, rad/s
DAMPING = 1e-4  # m²


@dataclass(frozen=True)
class Guard:
    """Limits the hand's speed towards each face of the box, and each joint's speed towards its
    limit, to the distance left divided by `slow_s`. Outside the box the hand can only move back.

    Of the arm only the hand is guarded: an elbow may leave the box.
    """

    workspace: Workspace
    joint_lower: Float64  # [J] rad
    joint_upper: Float64
    speeds: Float64  # [J] rad/s, of the joints
    acceleration: float = 0.0  # rad/s² of the ramp on which the arm brakes; 0: at once

    def stopping(
        self, velocity: Float64, position: Float64, place: Callable[[Float64], Float64]
    ) -> Float64:
        """The joint velocities [J] (rad/s), less if the hand would come to rest outside the box.

        The hand's way is curved, so its speed towards a face says little about where it ends. All
        joints slow down together, so the arm comes to rest on a line in the space of its joints.

        :param place: the hand's position [3] (m) for positions of the joints [J].
        """
        ramp_s = float(np.abs(velocity).max()) / (2 * self.acceleration) if self.acceleration else 0
        way = velocity * (BRAKE_S + ramp_s)
        most = max(0.0, self._outside(place(position))) + STRAY
        for share in np.linspace(0, 1, PLACES + 1)[1:]:
            if self._outside(place(position + share * way)) > most:
                return np.asarray(velocity * (share - 1 / PLACES))
        return velocity

    def _outside(self, hand: Float64) -> float:
        """How far a position [3] is outside the box; negative within; m."""
        return float(np.max([hand - self.workspace.upper, self.workspace.lower - hand]))

    @property
    def slow_s(self) -> float:
        """SLOW_S, and half of the longest ramp: while braking, the hand moves that far on."""
        ramp_s = float(self.speeds.max()) / self.acceleration if self.acceleration else 0.0
        return SLOW_S + ramp_s / 2

    def allowed(
        self, velocity: Float64, position: Float64, hand: Float64, jacobian: Float64
    ) -> Float64:
        """The joint velocities [J] (rad/s) closest to the wanted ones that the box allows.

        :param position: of the joints [J], rad.
        :param hand: position [3] in the base's frame, m.
        :param jacobian: of the hand's position, [3, J] m/rad.
        """
        # Each face and each joint's limit is a row: the speed towards it, and the greatest allowed.
        own = np.eye(len(velocity))
        rows = np.concatenate([jacobian, -jacobian, own, -own])
        box, lower, upper = self.workspace, self.joint_lower, self.joint_upper
        room = np.concatenate(
            [box.upper - hand, hand - box.lower, upper - position, position - lower]
        )
        most = np.maximum(room, 0.0) / self.slow_s
        most[6:] = np.minimum(most[6:], [*self.speeds, *self.speeds])
        kept = velocity
        for _ in range(ROUNDS):
            excess = rows @ kept - most
            fast = excess > TINY
            if not fast.any():
                return kept
            too_fast = rows[fast]
            square = too_fast @ too_fast.T + DAMPING * np.eye(len(too_fast))
            kept = kept - too_fast.T @ np.linalg.solve(square, excess[fast])
        # If a joint is still too fast, all joints slow down by the same factor.
        towards = rows @ kept
        over = towards > most + TINY
        return kept * min(1.0, *(most[over] / towards[over])) if over.any() else kept
