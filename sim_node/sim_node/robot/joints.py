"""Joint states at the time of the hand's pose, in the agent's order and signs. Without ROS."""

from __future__ import annotations

from bisect import bisect
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pa_ros.arena.errors import ArenaError
from pa_ros.core.experience import Float64
from sim_node.robot.settings import DriverJoint

KEPT = 1000  # joint states; a second of the fastest drivers


@dataclass(frozen=True)
class JointSample:
    """The agent's joint angles and velocities at one time."""

    position: Float64  # [J] rad
    velocity: Float64  # [J] rad/s
    stamp_ns: int  # on the driver's clock
    arrived_s: float  # on the receiver's monotonic clock


class JointHistory:
    """The newest joint states. The driver may publish at any rate."""

    def __init__(self, joints: Sequence[DriverJoint]) -> None:
        self.names = tuple(joint.name for joint in joints)
        self._signs = np.array([joint.sign for joint in joints])
        self._offsets = np.array([joint.offset for joint in joints])
        self._kept: deque[JointSample] = deque(maxlen=KEPT)

    def add(self, position: Float64, velocity: Float64, stamp_ns: int, arrived_s: float) -> None:
        """Keep a state of the driver's joints in the order of `names`, unless it is the one before.

        Raises ArenaError (`robot.joints`) if it has no time.
        """
        if not stamp_ns and self._kept:
            raise ArenaError(
                "joint_states: expected the time of measurement in header.stamp, got 0",
                code="robot.joints",
            )
        if self._kept and stamp_ns == self._kept[-1].stamp_ns:
            return
        if self._kept and stamp_ns < self._kept[-1].stamp_ns:
            self._kept.clear()  # the driver was restarted, or its clock was set back
        here = self._signs * position + self._offsets
        self._kept.append(JointSample(here, self._signs * velocity, stamp_ns, arrived_s))

    def at(self, stamp_ns: int) -> JointSample:
        """The state at a time, between the two nearest ones; before and after all, the newest.

        Raises ArenaError (`robot.joints`) if there is none at all.
        """
        if not self._kept:
            raise ArenaError(f"no joint_states of {list(self.names)} yet", code="robot.joints")
        newest = self._kept[-1]
        after = bisect(self._kept, stamp_ns, key=lambda sample: sample.stamp_ns)
        if after in (0, len(self._kept)):
            return newest
        earlier, later = self._kept[after - 1], self._kept[after]
        part = (stamp_ns - earlier.stamp_ns) / (later.stamp_ns - earlier.stamp_ns)
        position = earlier.position + part * (later.position - earlier.position)
        velocity = earlier.velocity + part * (later.velocity - earlier.velocity)
        return JointSample(position, velocity, stamp_ns, newest.arrived_s)

    def to_driver(self, position: Float64, velocity: Float64) -> tuple[Float64, Float64]:
        """The agent's joint positions and velocities [J] as the driver counts them."""
        return self._signs * (position - self._offsets), self._signs * velocity
