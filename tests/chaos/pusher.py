"""An agent that pushes the hand at the faces of its box, or turns all joints at random."""

from __future__ import annotations

import random
from typing import Any, Final

import mujoco
import numpy as np

from helpers.robots import CONFIG
from pa_ros.core.experience import Float64

FACE_S: Final = 4.0  # greatest time of one push
STUCK_S: Final = 1.0
STUCK: Final = 0.1  # rad/s; an arm that is slower after STUCK_S is stuck
NEAR_M: Final = 0.03  # from a face, another push is chosen
TURNS: Final = 0.5  # share of the pushes that turn the joints, whatever the hand does
LIMITS: Final = np.array(CONFIG.joint_speed_limits)  # rad/s


class Pusher:
    """Sees the simulated arm itself. The fastest joint turns as fast as it may."""

    def __init__(self, arm: Any, box: tuple[Float64, Float64], seed: int) -> None:
        """`arm`: a `SimulatedArm`; `box`: lower and upper corner, m."""
        self._arm, self._box, self._random = arm, box, random.Random(seed)
        self._choose(0.0)

    def action(self, now_s: float) -> Float64:
        """Shares of the joints' speed limits [6]."""
        data, hand = self._arm.data, self._arm.body("hand").position
        stuck = now_s > self._since_s + STUCK_S and np.abs(data.qvel[:6]).max() < STUCK
        if now_s > self._since_s + FACE_S or stuck or self._reach - self._face @ hand < NEAR_M:
            self._choose(now_s)
        velocity = self._turn if self._turns else self._jacobian_inverse() @ self._face
        share = velocity / LIMITS
        return np.asarray(share / np.abs(share).max())

    def _choose(self, now_s: float) -> None:
        """A face of the box, by its normal [3], and velocities of the joints [6]."""
        axis, up = self._random.randrange(3), self._random.random() < 0.5
        self._face = np.eye(3)[axis] * (1 if up else -1)
        self._reach = float(self._face @ self._box[int(up)])
        self._turn = np.array([self._random.uniform(-1, 1) for _ in range(6)])
        self._turns, self._since_s = self._random.random() < TURNS, now_s

    def _jacobian_inverse(self) -> Float64:
        """Joint velocities [6, 3] that move the hand along each axis."""
        model = self._arm.model
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacBody(model, self._arm.data, jacobian, None, model.body("hand").id)
        return np.asarray(np.linalg.pinv(jacobian[:, :6], rcond=0.05))
