"""robot_node with a clock that the rehearsal's arm sets, so that an hour takes minutes and a busy
machine changes nothing. Never for a real arm: what stops that one is its own clock."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from std_msgs.msg import Float64MultiArray

import sim_node.robot.node as node_module
import sim_node.robot.output as output_module
from pa_ros.ros import topics
from pa_ros.ros.node_main import run_node
from pa_ros.ros.topics import STEP, Topic
from pa_ros.wire.fields import NS, float64_field, read_stamp

PACED = Topic("paced", Float64MultiArray, STEP, STEP)
"""What is done: the time (ns), and the stamps of the newest step that an agent is to answer and of
the newest command. The clock may then continue."""


class PacedClock:
    """In the place of the module `time`, and of timers."""

    def __init__(self) -> None:
        self.ns = 0
        self._timers: list[list[Any]] = []  # period and next time (ns), callback

    def monotonic(self) -> float:
        return self.ns / NS

    def time_ns(self) -> int:
        return self.ns

    def timer(self, _node: Any, period_s: float, callback: Callable[[], None]) -> None:
        self._timers.append([round(period_s * NS), 0, callback])

    def set(self, ns: int) -> None:
        """Call what is due at a time, once each."""
        self.ns = ns
        for timer in self._timers:
            period, due, callback = timer
            if ns >= due:
                timer[1] = max(due + period, ns) if due else ns + period
                callback()


CLOCK = PacedClock()


class PacedRobot(node_module.RobotNode):
    """robot_node, which says what it has done."""

    def configure(self) -> None:
        super().configure()
        self._paced = PACED.publisher(self)
        self._answered_ns = 0
        self.subscribe(topics.ROS_CLOCK, self._on_clock)

    def _on_clock(self, message: Any) -> None:
        CLOCK.set(read_stamp(message.clock))
        self._tell()

    def _on_command(self, message: Any) -> None:
        self._answered_ns = read_stamp(message.stamp)
        try:
            super()._on_command(message)
        finally:
            self._tell()

    def _tell(self) -> None:
        moving = self.active and self._loss is None and not self._awaits_blocks
        awaited = self._step.observation.stamp_ns if moving and self._step is not None else 0
        done = np.array([CLOCK.ns, awaited, self._answered_ns], np.float64)
        self._paced.publish(Float64MultiArray(data=float64_field(done)))


def main() -> int:
    """Run as robot_node does."""
    for module in (node_module, output_module):
        vars(module)["time"] = CLOCK
    vars(node_module).update(now_ns=CLOCK.time_ns, steady_timer=CLOCK.timer)
    return run_node("robot_node", PacedRobot, settings="sim_node.robot.node:RobotConfig")


if __name__ == "__main__":
    sys.exit(main())
