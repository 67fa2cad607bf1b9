"""Commands also as real arms' controllers take them, with a ramp and a watchdog on our side."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from rclpy.node import Node

from agent_node.config import AgentConfig
from pa_ros.acting.velocity import VelocityRamp
from pa_ros.core.experience import Float32, Float64, Observation
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.wire.arena import ArenaDescription
from pa_ros.wire.views import encode_point, encode_velocities

WATCH_S = 0.05  # wall time


class Adapter:
    """Publishes each command as velocities (ros2_control's group controllers) or as a trajectory of
    one point (its joint trajectory controller). When commands stop, the arm is brought to rest."""

    def __init__(
        self, node: Node, config: AgentConfig, arena: Callable[[], ArenaDescription | None]
    ) -> None:
        """`arena`: whose joints and limits count."""
        self._config, self._arena = config, arena
        self._trajectory = config.controller == "joint_trajectory"
        topic = topics.JOINT_TRAJECTORY if self._trajectory else topics.VELOCITY_COMMANDS
        self._out = topic.publisher(node)
        self._ramp: VelocityRamp | None = None
        self._limits: tuple[float, ...] = ()
        self._joints: tuple[str, ...] = ()  # of the arm that is on the ramp
        self._position: Float64 = np.zeros(0)
        self._sent_at = self._ramped_at = time.monotonic()
        steady_timer(node, WATCH_S, self._watch)

    def send(self, action: Float32, observation: Observation) -> None:
        """Pass a command on, [J]."""
        arena = self._arena()
        if arena is None:
            return
        known = self._limits, self._joints
        if self._ramp is None or known != (arena.speed_limits, arena.joint_names):
            self._limits, self._joints = arena.speed_limits, arena.joint_names
            self._ramp = VelocityRamp(self._limits, self._config.max_acceleration)
        self._position = observation.joint_position
        self._sent_at = time.monotonic()
        self._publish(self._ramp, action, arena)

    def rest(self) -> None:
        """Commands have stopped, for good or for now: begin to come to rest at once."""
        self._sent_at = -math.inf
        self._watch()

    def stop(self) -> None:
        """To rest at once: nobody will be there to bring the arm down the ramp."""
        arena = self._arena()
        if arena is not None and self._moves(arena):
            at_rest = VelocityRamp(self._limits, 0.0)
            self._publish(at_rest, np.zeros(len(self._limits), np.float32), arena)

    def _watch(self) -> None:
        """Without commands for too long: down the ramp to rest, and then silence."""
        arena = self._arena()
        late = time.monotonic() - self._sent_at > self._config.output_timeout_s
        if late and arena is not None and self._moves(arena) and self._ramp is not None:
            self._publish(self._ramp, np.zeros(len(self._limits), np.float32), arena)

    def _moves(self, arena: ArenaDescription) -> bool:
        """Whether the arm is on its ramp; a ramp of other joints than the arena's is dropped."""
        if self._joints != arena.joint_names:
            self._ramp = None
        return self._ramp is not None and self._ramp.moving

    def _publish(self, ramp: VelocityRamp, action: Float32, arena: ArenaDescription) -> None:
        now = time.monotonic()
        elapsed, self._ramped_at = min(now - self._ramped_at, arena.control_period), now
        velocity = ramp.towards(action, elapsed)
        if not self._trajectory:
            self._out.publish(encode_velocities(velocity))
            return
        period_s = arena.control_period
        target = self._position + velocity * period_s
        self._out.publish(encode_point(arena.joint_names, target, velocity, period_s))
