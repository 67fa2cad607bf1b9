"""A vacuum cup in the simulation: it welds a block to the hand."""

from __future__ import annotations

import mujoco
import numpy as np

from pa_ros.arena.arms import VacuumCup
from pa_ros.core.experience import Float64
from pa_ros.world.relation import BLOCK_M


class Cup:
    """The gripper of one model and its data. What it holds is in the data, so copies hold it, too.

    While the cup is on it takes the block whose top is at its tip, if it holds none yet.
    """

    def __init__(self, cup: VacuumCup, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._cup, self._model, self._data = cup, model, data
        self._hand, self._active = model.body("hand").id, data.eq_active
        self._bodies = model.eq_obj2id  # of the block of each weld
        self.reach_m = cup.reach_m

    @property
    def holds(self) -> bool:
        """Whether it holds a block."""
        return bool(self._active.any())

    @property
    def held(self) -> int:
        """The body of the block that it holds, -1 for none."""
        return int(self._bodies[self._active.argmax()]) if self.holds else -1

    def switch(self, on: bool) -> None:
        """Before a control period: let go, if it is off."""
        if not on:
            self._active[:] = 0

    def take(self) -> None:
        """After a control period in which it was on: take a block at the tip, if it holds none."""
        if self.holds or not len(self._bodies):
            return
        data, cup = self._data, self._cup
        turn = data.xmat[self._hand].reshape(3, 3)
        tops = data.xpos[self._bodies] + (0.0, 0.0, BLOCK_M / 2) - data.xpos[self._hand]
        x, y, z = (tops @ turn).T  # in the frame of the hand
        beside = np.hypot(x, y)
        near = (beside < cup.beside_m) & (np.abs(z - self.reach_m) < cup.below_m)
        if near.any():
            self.hold(int(np.where(near, beside, np.inf).argmin()))

    def hold(self, weld: int) -> None:
        """Hold the block of a weld where it is now."""
        model, data, body = self._model, self._data, int(self._bodies[weld])
        turn, hand = data.xmat[self._hand].reshape(3, 3), data.xquat[self._hand]
        relative, back = np.zeros(4), hand * (1.0, -1.0, -1.0, -1.0)
        mujoco.mju_mulQuat(relative, back, data.xquat[body])
        place: Float64 = turn.T @ (data.xpos[body] - data.xpos[self._hand])
        # The point on the block, its place in the hand's frame, the turn, how much that counts
        model.eq_data[weld][:11] = (0.0, 0.0, 0.0, *place, *relative, 1.0)
        self._active[weld] = 1
