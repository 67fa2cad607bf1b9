"""What an agent publishes besides its commands: setpoints for controllers, markers for viewers."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from agent_node.acting import ActingNode
from pa_ros.core.experience import Float32, Float64
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription
from pa_ros.wire.views import encode_outlines, encode_setpoint
from pa_ros.world.poses import places
from pa_ros.world.velocity import VelocityRamp

# Wall time without commands after which controllers are sent to rest: three control periods, as the
# arena's own `command_timeout_s`.
OUTPUT_TIMEOUT_S = 0.3
WATCHDOG_S = 0.05  # wall time between two checks whether commands have stopped
LOOK_S = 0.5  # wall time until a new viewer is noticed


class ControllerOutput:
    """Publishes each command for ros2_control as well: as velocities (group controller), as a
    trajectory of one point (joint trajectory controller), or as a JointJog (MoveIt Servo).

    Velocities change no faster than `max_acceleration`. When commands stop, they go down to zero.
    """

    def __init__(self, node: ActingNode) -> None:
        config = node.config
        self._acceleration = config.max_acceleration
        self._node, self._form = node, config.controller
        self._out = topics.SETPOINTS[self._form].publisher(node)
        self._arena: ArenaDescription | None = None
        self._ramp = VelocityRamp((), 0.0)
        self._position: Float64 = np.zeros(0)  # of the joints, at the newest command
        self._sent_at = self._ramped_at = time.monotonic()
        steady_timer(node, WATCHDOG_S, self._stop_if_late)

    def bind(self, arena: ArenaDescription) -> None:
        """Command the arm of this arena from now on, which is at rest."""
        self._arena = arena
        self._ramp = VelocityRamp(arena.speed_limits, self._acceleration)

    def send(self, action: Float32, joint_position: Float64) -> None:
        """Publish a command.

        :param action: [J] in [-1, 1].
        :param joint_position: [J], rad, that the command answers.
        """
        self._position, self._sent_at = joint_position, time.monotonic()
        self._publish(action)

    def rest(self) -> None:
        """Start to bring the arm to rest, down the ramp."""
        self._sent_at = -math.inf
        self._stop_if_late()

    def stop(self) -> None:
        """Bring the arm to rest at once: nobody will be there to go down the ramp."""
        if self._arena is not None and self._ramp.moving:
            self._ramp = VelocityRamp(self._arena.speed_limits, 0.0)
            self._publish(np.zeros(len(self._arena.speed_limits), np.float32))

    def _stop_if_late(self) -> None:
        late = time.monotonic() - self._sent_at > OUTPUT_TIMEOUT_S
        if late and self._ramp.moving:
            self._position = self._position + self._ramp.velocity * self._elapsed_s()
            self._publish(np.zeros(len(self._ramp.velocity), np.float32))

    def _elapsed_s(self) -> float:
        """Time since the last command, as long as it lasts at most: one control period."""
        assert self._arena is not None
        return min(time.monotonic() - self._ramped_at, self._arena.control_period)

    def _publish(self, action: Float32) -> None:
        arena = self._arena
        assert arena is not None
        velocity = self._ramp.towards(action, self._elapsed_s())
        self._ramped_at, period_s = time.monotonic(), arena.control_period
        stamp_ns = self._node.get_clock().now().nanoseconds
        moving = arena.joint_names, self._position, velocity
        self._out.publish(encode_setpoint(self._form, *moving, period_s, stamp_ns))


class RelevanceMarkers:
    """Adds a shell around each block to the arena's markers, as opaque as p, for viewers.

    While somebody else subscribes to the markers, it does too, to learn the blocks' shapes.
    """

    def __init__(self, node: ActingNode) -> None:
        self._node = node
        self._out = topics.MARKERS.publisher(node)
        self._markers: Any = None  # subscription
        steady_timer(node, LOOK_S, self._look_for_viewers)

    def _look_for_viewers(self) -> None:
        own = int(self._markers is not None)
        wanted = self._out.get_subscription_count() > own
        if wanted and self._markers is None:
            self._markers = self._node.subscribe(topics.MARKERS, self._on_markers)
        elif not wanted and self._markers is not None:
            self._node.destroy_subscription(self._markers)
            self._markers = None

    def _on_markers(self, message: Message) -> None:
        if self._node.seen is None or not self._node.active:
            return
        step, goal = self._node.seen
        seen, p = step.observation, self._node.agent.relevance(step, goal)
        where = places(seen.hand_pose, seen.objects)
        where[seen.hand_index] = np.inf  # it is no block
        outlines = encode_outlines(message, where, p)
        if outlines is not None:  # none in an agent's own markers, which it receives, too
            self._out.publish(outlines)
