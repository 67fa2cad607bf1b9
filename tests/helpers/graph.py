"""A graph in this process: real nodes and real DDS, in the ROS domain of a test marked `graph`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.node import Node

from helpers.waiting import DEADLINE_S
from pa_ros.ros import topics
from pa_ros.ros.environment import prepare_environment
from pa_ros.ros.executor import release, spin_until
from pa_ros.wire import codec
from pa_ros.wire.records import Health, Outcome


class Probe(Node):
    """Hears every topic, speaks on any, and calls services."""

    def __init__(self) -> None:
        super().__init__("probe")
        self.heard: dict[str, list[Any]] = {}
        self.health: dict[str, Health] = {}
        self.nodes: list[Any] = []
        for topic in vars(topics).values():
            if isinstance(topic, topics.Topic):
                self._listen(topic)

    def _listen(self, topic: topics.Topic) -> None:
        messages = self.heard[topic.name] = []

        def receive(message: Any) -> None:
            messages.append(message)
            if topic is topics.DIAGNOSTICS:
                self.health |= {h.name: h for h in codec.decode_diagnostics(message)}

        self.create_subscription(topic.type, topic.name, receive, topic.reader)

    def until(self, condition: Callable[[], bool], timeout_s: float = DEADLINE_S) -> bool:
        """Serve every node of the graph until the condition holds; whether it does in time."""
        return spin_until(self, condition, timeout_s, *self.nodes)

    def count(self, topic: topics.Topic) -> int:
        return len(self.heard[topic.name])

    def last(self, topic: topics.Topic) -> Any:
        return self.heard[topic.name][-1]

    def reaches(self, step: int) -> bool:
        """Whether the arena comes to a step of its episode, in time."""
        features = topics.OBJECT_FEATURES
        return self.until(lambda: self.count(features) > 0 and self.last(features).step >= step)

    def value(self, node: str, key: str) -> str:
        """A value that a node reported last; empty if it has not."""
        health = self.health.get(f"/{node}")
        return health.values.get(key, "") if health else ""

    def message(self, node: str) -> str:
        """What a node said of itself last; empty if it has not."""
        health = self.health.get(f"/{node}")
        return health.message if health else ""

    def speaker(self, topic: topics.Topic) -> Any:
        """A publisher that someone listens to."""
        publisher = self.create_publisher(topic.type, topic.name, topic.writer)
        wanted = 2  # the probe itself and the node under test
        assert self.until(lambda: publisher.get_subscription_count() >= wanted)
        return publisher

    def call(self, service: tuple[str, Any], request: Any) -> Outcome:
        client = self.create_client(service[1], service[0])
        assert self.until(client.service_is_ready)
        future = client.call_async(request)
        assert self.until(future.done), f"{service[0]}: no answer"
        return codec.decode_outcome(future.result())


@contextmanager
def graph(*makers: Callable[[], Node], remaps: Any = (), **parameters: object) -> Iterator[Probe]:
    """The nodes and a probe beside them. Parameters are `node__name=value`, remaps "from:=to" for
    all, or "node:from:=to"."""
    prepare_environment()
    arguments = ["--ros-args", "--log-level", "error"]
    for rule in remaps:
        arguments += ["-r", rule]
    for key, value in parameters.items():
        node, _, name = key.partition("__")
        text = str(value).lower() if isinstance(value, bool) else str(value)
        arguments += ["-p", f"{node}:{name}:={text}"]
    rclpy.init(args=arguments)
    probe = Probe()
    try:
        for make in makers:
            probe.nodes.append(make())
        yield probe
    finally:
        try:
            for node in probe.nodes:  # those that a test put in others' places, too
                node.close()
        finally:  # as a process of its own does: what a node says last needs the executor
            release(probe)
            for node in probe.nodes:
                node.destroy_node()
            rclpy.shutdown()
