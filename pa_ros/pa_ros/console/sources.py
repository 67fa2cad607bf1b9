"""What the page subscribes to: the newest steps and pictures of an arena."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

from rclpy.node import Node

from pa_ros.ros.executor import take_messages
from pa_ros.ros.topics import Topic, quality
from pa_ros.wire import Message

DEPTH = 20  # steps kept between two looks: none is lost in real time at up to 20 times the speed


class Sampler:
    """Takes the newest messages of a topic of an arena now and then, at no cost in between.

    Its subscription is best effort, so no arena waits for it, and no executor serves its node, so
    messages that are not taken cost no Python.
    """

    def __init__(self, node: Node, namespace: str, depth: int, topic: Topic) -> None:
        """`node` must not be spun. `depth`: messages kept between two looks."""
        self._node, self._depth = node, depth
        topic = replace(topic.within(f"/{namespace}"), reader=quality(depth, reliable=False))
        self._reader = topic.subscribe(node, lambda _: None)

    def take(self) -> list[Message]:
        """The messages since the last call, in order."""
        return [message for message, _ in islice(take_messages(self._reader), self._depth)]

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._reader)
