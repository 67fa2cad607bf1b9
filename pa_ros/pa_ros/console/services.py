"""The arena's services, asked without waiting; what became of the last request."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from pa_ros.console import markup
from pa_ros.core.errors import PaError
from pa_ros.ros.topics import PAUSE, RESET, SPEED, STEP_SERVICE
from pa_ros.wire import codec
from pa_ros.wire.records import ResetRequest

REQUESTS: dict[str, tuple[tuple[str, Any], Callable[[float], Any]]] = {
    "pause": (PAUSE, lambda value: codec.encode_pause(bool(value))),
    "step": (STEP_SERVICE, lambda value: codec.encode_steps(int(value))),
    "speed": (SPEED, codec.encode_speed),
    "reset": (RESET, lambda value: codec.encode_reset(
        ResetRequest(None if value < 0 else int(value)))),
}  # fmt: skip


class ArenaServices:
    """Services of the arena in a namespace; clients are made when they are first needed."""

    def __init__(self, node: Node, namespace: str) -> None:
        self._node, self._namespace = node, namespace
        self._clients: dict[str, Any] = {}
        self._said = ""

    def ask(self, name: str, value: float) -> None:
        """Send a request; what becomes of it is in `html`."""
        (service, kind), encode = REQUESTS[name]
        if name not in self._clients:
            where = f"/{self._namespace}/{service}".replace("//", "/")
            self._clients[name] = self._node.create_client(kind, where)
        client = self._clients[name]
        try:
            request = encode(value)
        except (PaError, ValueError, AssertionError, OverflowError) as error:
            self._said = f"{name}: {error}"
            return
        self._said = f"{name}: asked, no answer yet"
        client.call_async(request).add_done_callback(lambda future: self._answered(name, future))

    def html(self) -> str:
        """The last request, and its answer."""
        return markup.quiet(self._said) if self._said else ""

    def _answered(self, name: str, future: Any) -> None:
        outcome = codec.decode_outcome(future.result())
        refused = f"refused: {outcome.code} {outcome.reason}"
        self._said = f"{name}: done" if outcome.success else f"{name}: {refused}"
