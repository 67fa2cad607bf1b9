"""Health of a node: in /diagnostics once a second, and in its log whenever it changes."""

from __future__ import annotations

import re
from collections.abc import Callable

from rclpy.node import Node

from pa_ros.ros.executor import steady_timer
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import DIAGNOSTICS
from pa_ros.wire.diagnostics import Health, encode_diagnostics

PERIOD_S = 1.0
PROGRESS_S = 5.0
OK, WARN, ERROR = 0, 1, 2
LIFECYCLE = "lifecycle"  # key in /diagnostics: the node's lifecycle state
LEARNER_ID = "learner_id"  # key in the /diagnostics of a learner
NUMBERS = re.compile(r"\d+(\.\d+)?")


class HealthReporter:
    """Publishes level, message and values of a node, and how much input it refused.

    A message that is not OK also says which input was refused last: the node may wait for it.

    The log gets a line when level or message change, and a line of `progress` every PROGRESS_S.
    """

    def __init__(
        self,
        node: Node,
        refusals: Refusals,
        collect: Callable[[], tuple[int, str, dict[str, str]]],
        progress: Callable[[], str],
    ) -> None:
        """
        :param collect: level, message and values to publish.
        :param progress: a line for the log, or an empty text for no line.
        """
        self._node, self._refusals = node, refusals
        self._collect, self._progress = collect, progress
        self._logged: tuple[int, str] | None = None
        self._publisher = DIAGNOSTICS.publisher(node)
        steady_timer(node, PERIOD_S, self.publish)
        steady_timer(node, PROGRESS_S, self._log_progress)

    def publish(self) -> None:
        """Publish now, besides once a second."""
        level, message, values = self._collect()
        if level != OK:
            message += self._refused_last(message)
        self._log_change(level, message)
        values |= {"refused": str(self._refusals.total), **self._refusals.values()}
        entry = Health(self._node.get_fully_qualified_name(), level, message, values)
        stamp_ns = self._node.get_clock().now().nanoseconds
        self._publisher.publish(encode_diagnostics([entry], stamp_ns))

    def _refused_last(self, message: str) -> str:
        """The newest refusal that the message doesn't state itself."""
        said = NUMBERS.sub("#", message)
        for where, reason in self._refusals.newest:
            if NUMBERS.sub("#", reason) not in said:
                return f"; refused: {where}: {reason}"
        return ""

    def _log_change(self, level: int, message: str) -> None:
        # A message with a number that counts up is logged once, not every second.
        state = level, NUMBERS.sub("#", message)
        if state == self._logged:
            return
        self._logged = state
        log = self._node.get_logger()
        # To wait for something is no fault of a node that has just started, so WARN is logged as
        # information.
        if level == ERROR:
            log.error(message)
        else:
            log.info(message)

    def _log_progress(self) -> None:
        line = self._progress()
        if line:
            self._node.get_logger().info(line)
