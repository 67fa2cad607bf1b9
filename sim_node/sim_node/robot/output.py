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
from sim_node.robot.relay import RESTS, SILENCE_S, Relay

if TYPE_CHECKING:
    from rclpy.node import Node

DRY_RUN = "dry_run"
TINY_S = 1e-6


class RobotOutput:
    """Sends velocities in the form that the controller takes; in a dry run, under dry_run/.

    What is sent follows from where the arm is believed to be (`RealArm.believed`), and is bounded
    by the guard at each message.
    """

    def __init__(self, node: Node, arm: RealArm, relay: Relay | None = None) -> None:
        """`relay`: the process that sends in this one's place."""
        self._arm, self._form, self._relay = arm, arm.settings.control, relay
        topic = topics.SETPOINTS[self._form]
        self._out: Any = (topic.within(DRY_RUN) if arm.settings.dry_run else topic).publisher(node)
        self._ramp = VelocityRamp([1.0] * len(arm.joints.names), arm.settings.max_acceleration)
        self._wanted = self._ramp.velocity
        self._sent_at = self._counted_at = self._asked_at = time.monotonic()
        self._moved = np.zeros(len(arm.joints.names))  # rad, by what was sent since `applied`
        self._rests = 0  # messages to send still, once the arm is at rest

    @property
    def velocity(self) -> Float64:
        """What was sent last, [J] rad/s, in the agent's signs."""
        return self._ramp.velocity

    def applied(self) -> Float64:
        """The mean of what was sent since the last call, as shares of the joints' limits, [J]."""
        now = time.monotonic()
        self._count(now)
        took_s, self._asked_at = max(now - self._asked_at, TINY_S), now
        mean, self._moved = self._moved / took_s, np.zeros_like(self._moved)
        return np.asarray(np.clip(mean / self._arm.about.speed_limits, -1.0, 1.0))

    def _count(self, now: float) -> None:
        """Add how far the arm has moved at the velocity sent last."""
        self._moved += self._ramp.velocity * (now - self._counted_at)
        self._counted_at = now

    def check(self) -> None:
        """Raises PaError (`robot.relay`) while the relay fails; then only `rest` helps."""
        if self._relay is not None:
            self._relay.check()

    def send(self, velocity: Float64) -> None:
        """Approach joint velocities [J] (rad/s) as fast as the limits allow."""
        self._wanted, self._rests = velocity, RESTS
        now, period_s = time.monotonic(), self._arm.about.control_period
        self._count(now)
        elapsed_s, self._sent_at = now - self._sent_at, now
        if elapsed_s > SILENCE_S:
            self._ramp.velocity[:] = 0.0  # the arm came to rest meanwhile
        wanted = self._ramp.towards(velocity, min(elapsed_s, period_s))
        self._arm.believed.move(now)
        # The box comes last, since it matters more than a smooth motion.
        speeds = self._arm.about.speed_limits
        self._ramp.velocity = np.clip(self._arm.allowed(wanted), np.negative(speeds), speeds)
        self._publish(now)

    def keep(self) -> None:
        """Continue with what was commanded last: the hand may be nearer to the box by now."""
        if self._rests:
            self.send(self._wanted)

    def rest(self) -> None:
        """Approach rest; call again until the arm is there."""
        if self._rests:
            left = self._rests if self._ramp.moving else self._rests - 1
            self.send(np.zeros_like(self._ramp.velocity))
            self._rests = left

    def stop(self) -> None:
        """Stop at once: nobody will be there to slow down."""
        if self._relay is not None:
            self._relay.close()
        if self._rests:
            self._ramp.velocity[:] = 0.0
            self._publish(time.monotonic())

    def _publish(self, now_s: float) -> None:
        joints, period_s = self._arm.joints, self._arm.about.control_period
        self._arm.believed.sent(self._ramp.velocity, now_s)
        where = joints.to_driver(self._arm.believed.position, self._ramp.velocity)
        if self._relay is None or not self._relay.send(where[1]):
            setpoint = encode_setpoint(self._form, joints.names, *where, period_s, time.time_ns())
            self._out.publish(setpoint)
