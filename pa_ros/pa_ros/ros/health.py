"""What a node says of itself: in /diagnostics once a second, in its log when that changes."""

from __future__ import annotations

import re
from collections.abc import Callable

from rclpy.node import Node

from pa_ros.ros.executor import steady_timer
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.rivals import Rivals
from pa_ros.ros.topics import DIAGNOSTICS, Topic
from pa_ros.wire import Message
from pa_ros.wire.diagnostics import Health, decode_diagnostics, encode_diagnostics

PERIOD_S = 1.0
PROGRESS_S = 5.0
OK, WARN, ERROR = 0, 1, 2
NUMBERS = re.compile(r"\d+(\.\d+)?")


class HealthReporter:
    """Publishes `collect()` under the node's full name, with the counts of its refusals.

    The log gets a line when what the node does, or waits for, has changed; and every `progress_s`
    a line of `progress()`, where there is one.
    """

    def __init__(
        self,
        node: Node,
        refusals: Refusals,
        collect: Callable[[], tuple[int, str, dict[str, str]]],
        progress: Callable[[], str] | None = None,
        progress_s: float = PROGRESS_S,
        hear: Callable[[Health], None] | None = None,
    ) -> None:
        """`hear`: is told what any node says."""
        self._node, self._refusals, self._collect, self._told = node, refusals, collect, hear
        self._rivals: Rivals | None = None
        DIAGNOSTICS.subscribe(node, refusals.guard(DIAGNOSTICS.name, self._hear))
        self._said: tuple[int, str] | None = None
        self._publisher = DIAGNOSTICS.publisher(node)
        steady_timer(node, PERIOD_S, self.publish)
        if progress is not None:
            steady_timer(node, progress_s, lambda: self._progress(progress))

    def alone(self, topic: Topic, instance: str) -> None:
        """From now on, one process alone should speak on a topic: this one, of this name."""
        self._rivals = Rivals(self._node.resolve_topic_name(topic.name), instance)

    def not_alone(self) -> None:
        """From now on anyone else may."""
        self._rivals = None

    def publish(self) -> None:
        """Publish now, besides the once a second."""
        level, message, values = self._collect()
        rivals = self._rivals
        if rivals is not None:
            values = {**values, **rivals.values}
            if rivals.alarm:
                level, message = max(level, WARN), f"{message}; {rivals.alarm}"
        self._say(level, message)
        values = {**values, "refused": str(self._refusals.total)}
        values |= self._refusals.values()
        entry = Health(self._node.get_fully_qualified_name(), level, message, values)
        stamp_ns = self._node.get_clock().now().nanoseconds
        self._publisher.publish(encode_diagnostics([entry], stamp_ns))

    def _hear(self, message: Message) -> None:
        for entry in decode_diagnostics(message):
            if self._rivals is not None:
                self._rivals.note(entry)
            if self._told is not None:
                self._told(entry)

    def _say(self, level: int, message: str) -> None:
        """Log what has changed since it was logged last."""
        said = level, NUMBERS.sub("#", message)  # of a number that goes on counting, the first
        if said == self._said:
            return
        self._said = said
        log = self._node.get_logger()
        if level == ERROR:
            log.error(message)
        else:
            log.info(message)  # to wait is no fault of a node that has just started

    def _progress(self, progress: Callable[[], str]) -> None:
        line = progress()
        if line:
            self._node.get_logger().info(line)
