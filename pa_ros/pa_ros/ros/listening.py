"""Time as a listener counts it: who could not be heard was not silent."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.node import Node

from pa_ros.ros.executor import steady_timer

TICK_S = 0.25  # at least so often a node looks at this clock
LONGEST_S = 0.5  # what a longer while between two looks counts for


class ListeningClock:
    """Seconds in which a process served its callbacks.

    While it stood still (stopped, suspended, without a processor) what others said waits unread:
    by a usual clock all of them would then have been silent for as long, and whoever is read first
    would take the others' place.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._at, self._listened_s = clock(), 0.0

    def __call__(self) -> float:
        """Seconds since it was made, of which no more than LONGEST_S between two calls."""
        now = self._clock()
        self._listened_s += min(now - self._at, LONGEST_S)
        self._at = now
        return self._listened_s


def listening_clock(node: Node) -> ListeningClock:
    """One that ticks as long as the node is served."""
    clock = ListeningClock()

    def tick() -> None:
        clock()

    steady_timer(node, TICK_S, tick)
    return clock
