"""For viewers: around each of the arena's blocks a shell that shows what the agent is told."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node

from agent_node.acting import Acting
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.wire import Message
from pa_ros.wire.views import encode_outlines

LOOK_S = 0.5  # wall time; how soon someone who looks is noticed


class Outlines:
    """The arena's markers again, as opaque as p of their objects; only while someone looks."""

    def __init__(self, node: Node, acting: Acting) -> None:
        self._node, self._acting = node, acting
        self._out = topics.RELEVANCE_MARKERS.publisher(node)
        self._markers: Any = None
        steady_timer(node, LOOK_S, self._look)

    def _look(self) -> None:
        wanted = self._out.get_subscription_count() > 0
        if wanted and self._markers is None:
            guarded = self._acting.refusals.guard(topics.MARKERS.name, self._on_markers)
            self._markers = topics.MARKERS.subscribe(self._node, guarded)
        elif not wanted and self._markers is not None:
            self._node.destroy_subscription(self._markers)
            self._markers = None

    def _on_markers(self, message: Message) -> None:
        seen = self._acting.seen
        if seen is None or not self._acting.active:
            return
        p = self._acting.agent.relevance(*seen)
        blocks = [degree for i, degree in enumerate(p) if i != seen[0].hand_index]
        self._out.publish(encode_outlines(message, blocks))
