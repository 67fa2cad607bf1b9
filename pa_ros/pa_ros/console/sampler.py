"""The newest control steps of an arena, looked at now and then: cheap however fast it runs.

Readers are best effort, so that no arena waits for them, and on a node that no executor serves:
what is not looked at costs no Python at all.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

from pa_ros.ros.topics import OBJECT_FEATURES, VERDICT, Topic
from pa_ros.wire import Message
from pa_ros.wire.fields import header_stamp

DEPTH = 20  # steps that may pass between two looks, none lost: real time up to 20 times
PARTS = {"features": OBJECT_FEATURES, "verdict": VERDICT}


class Sampler:
    """Steps of the arena in a namespace. `node` must not be served by an executor."""

    def __init__(
        self, node: Node, namespace: str, depth: int = DEPTH, parts: Mapping[str, Topic] = PARTS
    ) -> None:
        """`depth`: so many steps are kept between two looks. `parts`: the topics of a step."""
        self._node, self._depth = node, depth
        profile = QoSProfile(
            reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=depth
        )
        self._readers = {
            part: replace(topic, name=within(namespace, topic), reader=profile).subscribe(
                node, lambda _: None
            )
            for part, topic in parts.items()
        }
        self._open: dict[int, dict[str, Message]] = {}  # by stamp

    def take(self) -> list[dict[str, Message]]:
        """Whole steps that have come since the last look, as their parts' messages, in order."""
        for part, reader in self._readers.items():
            for message in _taken(reader, self._depth):
                self._open.setdefault(header_stamp(message), {})[part] = message
        stamps = sorted(stamp for stamp, parts in self._open.items() if len(parts) == len(PARTS))
        steps = [self._open[stamp] for stamp in stamps]
        if stamps:
            self._open = {s: parts for s, parts in self._open.items() if s > stamps[-1]}
        while len(self._open) > DEPTH:
            del self._open[min(self._open)]
        return steps

    def close(self) -> None:
        """Listen no more."""
        for reader in self._readers.values():
            self._node.destroy_subscription(reader)


def within(namespace: str, topic: Topic) -> str:
    """A topic's full name below a namespace."""
    return topic.name if topic.name.startswith("/") else f"/{namespace}/{topic.name}".replace(
        "//", "/"
    )  # fmt: skip


def _taken(reader: Any, depth: int) -> Iterator[Message]:
    """What waits at a reader, as an executor would take it."""
    for _ in range(depth):
        with reader.handle:
            found = reader.handle.take_message(reader.msg_type, False)
        if found is None:
            return
        yield found[0]
