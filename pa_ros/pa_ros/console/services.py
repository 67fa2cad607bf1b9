"""The arena's services, asked without waiting; what became of the last request."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.node import Node

from pa_ros.console import markup
from pa_ros.core.body import Body
from pa_ros.core.errors import PaError
from pa_ros.ros.topics import (
    GET_ENTITIES,
    RESET,
    SET_ENTITY_STATE,
    SET_SIMULATION_STATE,
    SPEED,
    STEP_SIMULATION,
)
from pa_ros.wire.services import (
    ResetRequest,
    decode_outcome,
    encode_reset,
    encode_speed,
)
from pa_ros.wire.simulator import (
    ResultCode,
    SimState,
    decode_names,
    decode_result,
    encode_state_change,
    encode_state_request,
    encode_steps_request,
)

REQUESTS: dict[str, tuple[tuple[str, Any], Callable[[float], Any]]] = {
    "pause": (SET_SIMULATION_STATE, lambda value: encode_state_request(
        SimState.PAUSED if value else SimState.PLAYING)),
    "step": (STEP_SIMULATION, lambda value: encode_steps_request(int(value))),
    "speed": (SPEED, encode_speed),
    "reset": (RESET, lambda value: encode_reset(
        ResetRequest(None if value < 0 else int(value)))),
}  # fmt: skip


class ArenaServices:
    """Services of the arena in a namespace; clients are made when they are first needed."""

    def __init__(self, node: Node, namespace: str) -> None:
        self._node, self._namespace = node, namespace
        self._clients: dict[str, Any] = {}
        self._said = ""

    def close(self) -> None:
        """Another arena is looked at; what is under way goes unanswered."""
        for client in self._clients.values():
            self._node.destroy_client(client)
        self._clients.clear()

    def ask(self, name: str, value: float) -> None:
        """Send a request; what becomes of it is in `html`."""
        service, encode = REQUESTS[name]
        client = self._client(service)
        try:
            request = encode(value)
        except (PaError, ValueError, AssertionError, OverflowError) as error:
            self._said = f"{name}: {error}"
            return
        self._said = f"{name}: asked, no answer yet"
        answered = self._told(name, lambda future: self._answered(name, future))
        client.call_async(request).add_done_callback(answered)

    def move(self, block: int, x: float, y: float) -> None:
        """Put a block, by its number in Ω without the hand, elsewhere on the table (m)."""
        place = Body.at_rest(np.array([x, y, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))

        def named(future: Any) -> None:
            names = decode_names(future.result())[1:]
            if not 0 <= block < len(names):
                self._said = f"move: expected one of {len(names)} blocks, got number {block}"
                return
            request = encode_state_change(names[block], place)
            moving = self._client(SET_ENTITY_STATE).call_async(request)
            moving.add_done_callback(self._told("move", lambda done: moved(names[block], done)))

        def moved(name: str, future: Any) -> None:
            code, reason = decode_result(future.result())
            self._said = f"move {name}: " + ("done" if code == ResultCode.OK else reason)

        self._said = "move: asked, no answer yet"
        asked = self._client(GET_ENTITIES).call_async(GET_ENTITIES[1].Request())
        asked.add_done_callback(self._told("move", named))

    def _told(self, name: str, answered: Callable[[Any], None]) -> Callable[[Any], None]:
        """The callback of an answer; what it raises is said."""

        def told(future: Any) -> None:
            try:
                answered(future)
            except Exception as error:
                self._said = f"{name}: {type(error).__name__}: {error}"

        return told

    def _client(self, service: tuple[str, Any]) -> Any:
        """Made when it is first needed."""
        name, kind = service
        if name not in self._clients:
            where = f"/{self._namespace}/{name}".replace("//", "/")
            self._clients[name] = self._node.create_client(kind, where)
        return self._clients[name]

    def html(self) -> str:
        """The last request, and its answer."""
        return markup.quiet(self._said) if self._said else ""

    def _answered(self, name: str, future: Any) -> None:
        outcome = decode_outcome(future.result())
        refused = f"refused: {outcome.code} {outcome.reason}"
        self._said = f"{name}: done" if outcome.success else f"{name}: {refused}"
