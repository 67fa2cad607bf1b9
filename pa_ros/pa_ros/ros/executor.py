"""Spinning: the fast executor, made to stop when asked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import WeakKeyDictionary, WeakSet

from rclpy.clock import Clock, ClockType
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future

from pa_ros.core.signals import interruption_held

POLL_S = 0.1


def steady_timer(node: Node, period_s: float, callback: Callable[[], None]) -> Any:
    """A timer of wall time, whatever the node's clock is."""
    return node.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def spin_until(
    node: Node, condition: Callable[[], bool], timeout_s: float | None, *others: Node
) -> bool:
    """Serve callbacks on this thread until the condition holds or the time is up; whether it holds.

    The condition is looked at every POLL_S. Callbacks of `others` are served too. Signals raise
    Interrupted (`signals_interrupt`) between callbacks, never in one or in the executor's C++.

    EventsExecutor is three times as fast as the others, but its `spin()` never returns, and its
    time-outs don't fire under continuous traffic: a timer completes a future instead. The timer
    also lets Python run its signal handlers.
    """
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    deadline = None if timeout_s is None else clock.now().nanoseconds + int(timeout_s * 1e9)
    finished: Future = Future()

    executor = _executor_of(node, others)
    with interruption_held() as interrupted:

        def poll() -> None:
            late = deadline is not None and clock.now().nanoseconds >= deadline
            if (late or interrupted() or condition()) and not finished.done():
                finished.set_result(None)

        timer = node.create_timer(POLL_S, poll, clock=clock)
        _polls.add(timer)
        try:
            poll()
            while not finished.done():
                executor.spin_until_future_complete(finished, timeout_sec=1.0)
        finally:
            node.destroy_timer(timer)
    return condition()


_executors: WeakKeyDictionary[Node, Any] = WeakKeyDictionary()
_polls: WeakSet[Any] = WeakSet()


def is_of_spinning(entity: object) -> bool:
    """Whether it is a timer of `spin_until`, which without it would not end."""
    return entity in _polls


def _executor_of(node: Node, others: tuple[Node, ...]) -> Any:
    """One executor for a node's whole life: what comes between two spins would go unnoticed by
    a new one, and its readers lag behind by as much ever after."""
    executor = _executors.get(node)
    if executor is None:
        executor = _executors[node] = EventsExecutor()
    for served in (node, *others):
        if served.executor is None:
            executor.add_node(served)
    return executor


def release(node: Node) -> None:
    """Take a node that was spun out of its executor; call before destroying it."""
    executor = _executors.pop(node, None)
    if executor is not None:
        executor.shutdown()
