"""Joint states at the time of the hand's pose, in the agent's order and signs. Without ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pa_ros.core.experience import Float64
from sim_node.robot.frames import RobotError
from sim_node.robot.settings import Joint

KEPT_NS = 1_000_000_000  # of joint states before the newest


@dataclass(frozen=True)
class JointSample:
    """The agent's joint angles and velocities at one time."""

    position: Float64  # [J] rad
    velocity: Float64  # [J] rad/s
    stamp_ns: int  # on the driver's clock
    arrived_s: float  # on the receiver's monotonic clock


class JointHistory:
    """The joint states of the last second. The driver may publish at any rate."""

    def __init__(self, joints: Sequence[Joint]) -> None:
        self.names = tuple(joint.name for joint in joints)
        self._signs = np.array([joint.sign for joint in joints])
        self._offsets = np.array([joint.offset for joint in joints])
        self._kept: deque[JointSample] = deque()
        self.driver_position = np.zeros(len(joints))  # [J] rad, the newest as the driver sent it

    def add(
        self, position: Float64, velocity: Float64 | None, stamp_ns: int, arrived_s: float
    ) -> None:
        """Keep a state of the driver's joints in the order of `names`.

        Without velocities they are computed from the positions. A state with the stamp of the one
        before it is ignored: it is the same measurement.
        """
        newest = self._kept[-1] if self._kept else None
        if newest and stamp_ns < newest.stamp_ns:  # the driver was started again
            self._kept.clear()
            newest = None
        if newest and stamp_ns == newest.stamp_ns:
            return
        self.driver_position = position
        here = self._signs * position + self._offsets
        if velocity is not None:
            speed = self._signs * velocity
        elif newest:
            speed = (here - newest.position) / ((stamp_ns - newest.stamp_ns) / 1e9)
        else:
            speed = np.zeros(len(here))
        self._kept.append(JointSample(here, speed, stamp_ns, arrived_s))
        while self._kept[0].stamp_ns < stamp_ns - KEPT_NS:
            self._kept.popleft()

    def at(self, stamp_ns: int) -> JointSample:
        """The state at a time, between the two nearest ones; after the newest one, the newest.

        Raises RobotError (`robot.joints`) if there is none at all.
        """
        if not self._kept:
            raise RobotError(f"no joint_states of {list(self.names)} yet", code="robot.joints")
        newest = later = self._kept[-1]
        for earlier in reversed(self._kept):
            if earlier.stamp_ns <= stamp_ns:
                break
            later = earlier
        else:
            return newest  # the time is of another clock, or older than all
        if later.stamp_ns <= stamp_ns:
            return newest
        part = (stamp_ns - earlier.stamp_ns) / (later.stamp_ns - earlier.stamp_ns)
        position = earlier.position + part * (later.position - earlier.position)
        velocity = earlier.velocity + part * (later.velocity - earlier.velocity)
        return JointSample(position, velocity, stamp_ns, newest.arrived_s)

    def to_driver(self, velocity: Float64) -> Float64:
        """The agent's joint velocities [J] in the driver's signs."""
        return np.asarray(self._signs * velocity)
