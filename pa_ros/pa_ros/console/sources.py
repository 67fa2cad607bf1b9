"""What the page subscribes to: the newest steps of an arena."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

from pa_ros.ros.executor import take_messages
from pa_ros.ros.topics import OBJECT_FEATURES, Topic
from pa_ros.wire import Message

DEPTH = 20  # steps kept between two looks: none is lost in real time at up to 20 times the speed


class Sampler:
    """Takes the newest control steps of an arena now and then, at no cost in between.

    Its subscription is best effort, so no arena waits for it, and no executor serves its node, so
    messages that are not taken cost no Python.
    """

    def __init__(
        self, node: Node, namespace: str, depth: int = DEPTH, steps: Topic = OBJECT_FEATURES
    ) -> None:
        """`node` must not be spun. `depth`: steps kept between two looks."""
        self._node, self._depth = node, depth
        profile = QoSProfile(
            reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=depth
        )
        steps = replace(steps.within(f"/{namespace}"), reader=profile)
        self._reader = steps.subscribe(node, lambda _: None)

    def take(self) -> list[Message]:
        """The steps since the last call, in order."""
        return [message for message, _ in islice(take_messages(self._reader), self._depth)]

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._reader)
