"""Spin nodes with rclpy's fast executor, in a way that can be stopped."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from typing import Any
from weakref import WeakKeyDictionary, WeakSet

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future

from pa_ros.core.signals import interruption_held

POLL_S = 0.1


def steady_timer(node: Node, period_s: float, callback: Callable[[], None]) -> Any:
    """Create a timer that runs on wall time, whatever the node's clock is."""
    return node.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def node_beside(node: Node, suffix: str) -> Node:
    """A second node in the namespace of a node, for subscriptions that no executor serves."""
    return rclpy.create_node(
        f"{node.get_name()}_{suffix}",
        namespace=node.get_namespace(),
        context=node.context,
        enable_rosout=False,
        start_parameter_services=False,
    )


def take_messages(subscription: Any, raw: bool = False) -> Iterator[tuple[Any, Any]]:
    """Yield what waits at a subscription that no executor serves: each message (`raw`: as bytes),
    and what the middleware says of it."""
    while True:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, raw)
        if taken is None:
            return
        yield taken


def spin_until(
    node: Node, condition: Callable[[], bool], timeout_s: float | None, *others: Node
) -> bool:
    """Run callbacks of a node and others until a condition is true; whether it became true in time.

    The condition is checked every POLL_S. A signal raises Interrupted (`signals_interrupt`) between
    callbacks, never within one.

    EventsExecutor is three times as fast as rclpy's other executors, but its `spin()` never returns
    and its time-outs don't fire under continuous traffic. So a timer checks the condition and
    completes a future. The timer also lets Python run its signal handlers.
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


def is_poll_timer(entity: object) -> bool:
    """Whether an entity is the timer of `spin_until`, which never returns if it is destroyed."""
    return entity in _polls


def _executor_of(node: Node, others: tuple[Node, ...]) -> Any:
    """The executor of a node, made at its first spin.

    It is kept, because a new one doesn't notice messages that arrived before it was made, and its
    subscriptions then lag behind by as many.
    """
    executor = _executors.get(node)
    if executor is None:
        # It enables faulthandler, which needs a real file: notebooks and tests replace sys.stderr.
        with redirect_stderr(sys.__stderr__ or sys.stderr):
            executor = _executors[node] = EventsExecutor(context=node.context)
    for served in (node, *others):
        if served.executor is None:
            executor.add_node(served)
    return executor


def release(node: Node) -> None:
    """Shut down a node's executor; call before destroying the node."""
    executor = _executors.pop(node, None)
    if executor is not None:
        executor.shutdown()
