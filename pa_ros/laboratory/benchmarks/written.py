"""Messages with the time at which their writer handed them to DDS.

So the time which the measuring process waits for a processor does not count.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile

from pa_ros.ros.executor import steady_timer
from pa_ros.ros.topics import Topic
from pa_ros.wire import Message

TICK_S = 0.005
DEEP = QoSProfile(depth=10_000)  # keeps what arrives while the machine does something else

Receive = Callable[[int, Message, float], None]
"""Receives the number of the topic, a message, and when it was written, in s."""


class WrittenMessages:
    """Reads topics beside a node, which must be spun, and passes messages on in written order.

    The topic of an effect comes after that of its cause.
    """

    def __init__(self, node: Node, topics: Sequence[Topic], receive: Receive) -> None:
        # A node without an executor: rclpy's executor does not report when a message was written.
        self._reader = rclpy.create_node(f"{node.get_name()}_reader", context=node.context)
        self._receive = receive
        self._read = [
            self._reader.create_subscription(topic.type, topic.name, lambda _: None, DEEP)
            for topic in topics
        ]
        steady_timer(node, TICK_S, self._tick)

    def close(self) -> None:
        """Unsubscribe."""
        self._reader.destroy_node()

    def _tick(self) -> None:
        received = []
        # An effect is read before its cause, so that no effect seems to be without one.
        for number, subscription in reversed([*enumerate(self._read)]):
            handle = subscription.handle
            with handle:  # it enters as None
                while taken := handle.take_message(subscription.msg_type, False):
                    received.append((taken[1]["source_timestamp"], number, taken[0]))
        for written_ns, number, message in sorted(received, key=lambda one: one[:2]):
            self._receive(number, message, written_ns * 1e-9)
