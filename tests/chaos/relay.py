"""A relay between nodes: what one publishes on NAME, others read on relayed/NAME."""

import random
from collections.abc import Callable
from typing import Any, Final

from rclpy.node import Node

from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.topics import Topic

CHANGES: Final = ("dropped", "duplicated", "delayed", "reordered")
SHARE: Final = 0.3  # of the messages
DELAY_S: Final = 0.25
RELAYED: Final = (  # topic, and the node that reads it through the relay
    (topics.TRAJECTORIES, "learner_node"),
    (topics.POLICY_WEIGHTS, "agent_node"),
    (topics.JOINT_COMMANDS, "sim_node"),
    (topics.OBJECT_FEATURES, "agent_node"),
)


def remaps(node: str) -> dict[str, str]:
    """The topics that a node reads through the relay."""
    return {t.name: f"relayed/{t.name}" for t, reader in RELAYED if reader == node}


class Relay:
    """Forwards every message in order, except on topics with an entry in `changes`."""

    def __init__(self, node: Node, seed: int = 0) -> None:
        self.changes: dict[str, str] = {}  # one of CHANGES by topic
        self._node, self._rng = node, random.Random(seed)
        self._held: dict[str, bytes] = {}  # a message that is to follow the next, by topic
        for topic, _ in RELAYED:
            self._connect(topic)

    def _connect(self, topic: Topic) -> None:
        out = self._node.create_publisher(topic.type, f"relayed/{topic.name}", topic.writer)
        forward = self._forwarder(topic.name, out.publish)
        self._node.create_subscription(topic.type, topic.name, forward, topic.reader, raw=True)

    def _forwarder(self, name: str, publish: Callable[[bytes], object]) -> Callable[[bytes], None]:
        def forward(payload: bytes) -> None:
            held = self._held.pop(name, None)
            change = self.changes.get(name) if self._rng.random() < SHARE else None
            if change == "delayed":
                self._publish_later(publish, payload)
            elif change == "reordered" and held is None:
                self._held[name] = payload
            elif change != "dropped":
                publish(payload)
                if change == "duplicated":
                    publish(payload)
            if held is not None:
                publish(held)

        return forward

    def _publish_later(self, publish: Callable[[bytes], object], payload: bytes) -> None:
        timers: list[Any] = []

        def fire() -> None:
            self._node.destroy_timer(timers[0])
            publish(payload)

        timers.append(steady_timer(self._node, DELAY_S, fire))
