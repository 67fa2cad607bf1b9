"""What goes to the arm's controller: velocities within acceleration limits and the box."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from pa_ros.core.experience import Float64
from pa_ros.ros import topics
from pa_ros.wire import Message
from pa_ros.wire.views import encode_jog, encode_point, encode_velocities
from pa_ros.world.velocity import VelocityRamp
from sim_node.robot.arm import RealArm

if TYPE_CHECKING:
    from rclpy.node import Node

TOPICS = {
    "velocity": topics.VELOCITY_COMMANDS,
    "joint_trajectory": topics.JOINT_TRAJECTORY,
    "joint_jog": topics.JOINT_JOG,
}
DRY_RUN = "dry_run"
RESTS = 8  # messages that say "stop" once the arm is at rest, in case one is lost


class Output:
    """Sends velocities in the form that the controller takes; in a dry run, under dry_run/."""

    def __init__(self, node: Node, arm: RealArm) -> None:
        self._arm, self._settings = arm, arm.settings
        topic = TOPICS[self._settings.control]
        if self._settings.dry_run:
            topic = topic.within(DRY_RUN)
        self._out: Any = topic.publisher(node)
        self._ramp = VelocityRamp([1.0] * len(arm.joints.names), self._settings.max_acceleration)
        self._sent_at = time.monotonic()
        self._rests = RESTS

    @property
    def velocity(self) -> Float64:
        """What was sent last, [J] rad/s, in the agent's signs."""
        return self._ramp.velocity

    def send(self, velocity: Float64) -> None:
        """Approach joint velocities [J] (rad/s) as fast as the limits allow."""
        self._rests = 0
        self._approach(velocity)

    def rest(self) -> None:
        """Approach rest; call again until the arm is there."""
        if self._ramp.moving or self._rests < RESTS:
            self._rests += not self._ramp.moving
            self._approach(np.zeros_like(self._ramp.velocity))

    def stop(self) -> None:
        """Stop at once: nobody will be there to slow down."""
        if self._ramp.moving or self._rests < RESTS:
            self._ramp.velocity[:] = 0.0
            self._out.publish(self._message(self._ramp.velocity))

    def _approach(self, velocity: Float64) -> None:
        now = time.monotonic()
        elapsed_s, self._sent_at = min(now - self._sent_at, self._settings.period_s), now
        # The box comes last, since it matters more than a smooth motion.
        allowed = self._arm.allowed(self._ramp.towards(velocity, elapsed_s))
        self._ramp.velocity = allowed
        self._out.publish(self._message(allowed))

    def _message(self, velocity: Float64) -> Message:
        joints, period_s = self._arm.joints, self._settings.period_s
        speed = joints.to_driver(velocity)
        if self._settings.control == "velocity":
            return Message(encode_velocities(speed))
        if self._settings.control == "joint_jog":
            return Message(encode_jog(joints.names, speed, period_s, time.time_ns()))
        target = joints.driver_position + speed * period_s
        return Message(encode_point(joints.names, target, speed, period_s))
