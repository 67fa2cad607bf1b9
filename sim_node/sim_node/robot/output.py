"""What goes to the arm's controller: velocities within acceleration limits and the box."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from pa_ros.core.experience import Float64
from pa_ros.ros import topics
from pa_ros.wire.views import encode_setpoint
from pa_ros.world.velocity import VelocityRamp
from sim_node.robot.arm import RealArm

if TYPE_CHECKING:
    from rclpy.node import Node

DRY_RUN = "dry_run"
RESTS = 8  # messages that say "stop" once the arm is at rest, in case one is lost


class RobotOutput:
    """Sends velocities in the form that the controller takes; in a dry run, under dry_run/."""

    def __init__(self, node: Node, arm: RealArm) -> None:
        self._arm, self._form = arm, arm.settings.control
        topic = topics.SETPOINTS[self._form]
        self._out: Any = (topic.within(DRY_RUN) if arm.settings.dry_run else topic).publisher(node)
        self._ramp = VelocityRamp([1.0] * len(arm.joints.names), arm.settings.max_acceleration)
        self._sent_at = time.monotonic()
        self._rests = 0  # messages to send still, once the arm is at rest

    @property
    def velocity(self) -> Float64:
        """What was sent last, [J] rad/s, in the agent's signs."""
        return self._ramp.velocity

    def send(self, velocity: Float64) -> None:
        """Approach joint velocities [J] (rad/s) as fast as the limits allow."""
        self._rests = RESTS
        now, period_s = time.monotonic(), self._arm.about.control_period
        elapsed_s, self._sent_at = min(now - self._sent_at, period_s), now
        # The box comes last, since it matters more than a smooth motion.
        self._ramp.velocity = self._arm.allowed(self._ramp.towards(velocity, elapsed_s))
        self._publish()

    def rest(self) -> None:
        """Approach rest; call again until the arm is there."""
        if self._rests:
            left = self._rests if self._ramp.moving else self._rests - 1
            self.send(np.zeros_like(self._ramp.velocity))
            self._rests = left

    def stop(self) -> None:
        """Stop at once: nobody will be there to slow down."""
        if self._rests:
            self._ramp.velocity[:] = 0.0
            self._publish()

    def _publish(self) -> None:
        joints, period_s = self._arm.joints, self._arm.about.control_period
        speed = joints.to_driver(self._ramp.velocity)
        where = joints.names, joints.driver_position, speed
        self._out.publish(encode_setpoint(self._form, *where, period_s, time.time_ns()))
