"""A relay between nodes: what one publishes on NAME, the others read on relayed/NAME, perhaps."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any, Final, Literal

from rclpy.node import Node

from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.topics import Topic

Deed = Literal["drop", "duplicate", "delay", "reorder"]
DEEDS: Final[tuple[Deed, ...]] = ("drop", "duplicate", "delay", "reorder")
SHARE: Final = 0.3  # of messages that something is done to
DELAY_S: Final = 0.25
RELAYED: Final = (  # and who reads what is relayed
    (topics.TRAJECTORIES, "learner_node"),
    (topics.POLICY_WEIGHTS, "agent_node"),
    (topics.JOINT_COMMANDS, "sim_node"),
    (topics.OBJECT_FEATURES, "agent_node"),
)


def remaps(node: str) -> dict[str, str]:
    """What a node of a relayed graph reads elsewhere."""
    return {t.name: f"relayed/{t.name}" for t, reader in RELAYED if reader == node}


class Relay:
    """Hands every message on, in order, until `deed` says otherwise for one topic."""

    def __init__(self, node: Node, seed: int = 0) -> None:
        self.deeds: dict[str, Deed] = {}  # by topic
        self.done = 0  # messages that something was done to
        self._node, self._rng = node, random.Random(seed)
        self._held: dict[str, bytes] = {}
        for topic, _ in RELAYED:
            self._lay(topic)

    def _lay(self, topic: Topic) -> None:
        out = self._node.create_publisher(topic.type, f"relayed/{topic.name}", topic.writer)
        hand_on = self._hand_on(topic.name, out.publish)
        self._node.create_subscription(topic.type, topic.name, hand_on, topic.reader, raw=True)

    def _hand_on(self, name: str, publish: Callable[[bytes], object]) -> Callable[[bytes], None]:
        def hand_on(payload: bytes) -> None:
            held = self._held.pop(name, None)
            deed = self.deeds.get(name) if self._rng.random() < SHARE else None
            self.done += deed is not None
            if deed == "delay":
                self._later(publish, payload)
            elif deed == "reorder" and held is None:
                self._held[name] = payload
            elif deed != "drop":
                publish(payload)
                if deed == "duplicate":
                    publish(payload)
            if held is not None:
                publish(held)

        return hand_on

    def _later(self, publish: Callable[[bytes], object], payload: bytes) -> None:
        timers: list[Any] = []

        def fire() -> None:
            self._node.destroy_timer(timers[0])
            publish(payload)

        timers.append(steady_timer(self._node, DELAY_S, fire))
