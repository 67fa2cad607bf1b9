"""What a node says of itself in /diagnostics, once a second."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from pa_ros.ros.executor import steady_timer
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import DIAGNOSTICS
from pa_ros.wire import codec
from pa_ros.wire.records import Health

PERIOD_S = 1.0
OK, WARN, ERROR = 0, 1, 2


class HealthReporter:
    """Publishes `collect()` under the node's full name, with the counts of its refusals."""

    def __init__(
        self,
        node: Node,
        refusals: Refusals,
        collect: Callable[[], tuple[int, str, dict[str, str]]],
        period_s: float = PERIOD_S,
    ) -> None:
        self._node, self._refusals, self._collect = node, refusals, collect
        self._publisher = DIAGNOSTICS.publisher(node)
        steady_timer(node, period_s, self.publish)

    def publish(self) -> None:
        """Publish now, besides the once a second."""
        level, message, values = self._collect()
        values = {**values, "refused": str(self._refusals.total), **self._refusals.values()}
        entry = Health(self._node.get_fully_qualified_name(), level, message, values)
        stamp_ns = self._node.get_clock().now().nanoseconds
        self._publisher.publish(codec.encode_diagnostics([entry], stamp_ns))
