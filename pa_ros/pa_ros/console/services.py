"""Requests to an arena's services without waiting, and what became of the last one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.node import Node

from pa_ros.console import markup
from pa_ros.core.experience import Body
from pa_ros.ros.topics import (
    GET_ENTITIES,
    RESET,
    SET_ENTITY_STATE,
    SET_SIMULATION_STATE,
    SPEED,
    STEP_SIMULATION,
)
from pa_ros.wire.services import ResetRequest, decode_outcome, encode_reset, encode_speed
from pa_ros.wire.simulator import (
    SimState,
    decode_names,
    encode_state_change,
    encode_state_request,
    encode_steps_request,
)

Answered = Callable[[Any], str]
"""Returns what a service's response says, in a few words."""


class ArenaServices:
    """The services of the arena in a namespace. Clients are created when they are first needed."""

    def __init__(self, node: Node, namespace: str) -> None:
        self._node, self._namespace = node, namespace
        self._clients: dict[str, Any] = {}
        self._status = ""

    def close(self) -> None:
        """Destroy the clients; requests that are not answered yet are dropped."""
        for client in self._clients.values():
            self._node.destroy_client(client)
        self._clients.clear()

    def pause(self, paused: bool) -> None:
        """Pause the arena, or let it resume."""
        name, state = ("pause", SimState.PAUSED) if paused else ("resume", SimState.PLAYING)
        self._call(name, SET_SIMULATION_STATE, encode_state_request(state), _outcome)

    def step(self) -> None:
        """Let a paused arena make one control step."""
        self._call("step", STEP_SIMULATION, encode_steps_request(1), _outcome)

    def set_speed(self, times: float) -> None:
        """Set the speed, in multiples of real time."""
        self._call("speed", SPEED, encode_speed(times), _outcome)

    def reset(self, episode: int | None) -> None:
        """Begin an episode by its number, or the next one."""
        self._call("reset", RESET, encode_reset(ResetRequest(episode)), _outcome)

    def move(self, block: int, x: float, y: float) -> None:
        """Move a block, by its row in Ω without the hand, to a place on the table (m)."""
        place = Body.at_rest(np.array([x, y, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))

        def find_block(response: Any) -> str:
            names = decode_names(response)[1:]  # the first is the arm
            if block >= len(names):
                return f"expected one of {len(names)} blocks, got number {block}"
            request = encode_state_change(names[block], place)
            self._call(f"move {names[block]}", SET_ENTITY_STATE, request, _outcome)
            return ""

        self._call("move", GET_ENTITIES, GET_ENTITIES[1].Request(), find_block)

    def html(self) -> str:
        """The last request, and its answer."""
        return markup.quiet(self._status) if self._status else ""

    def _call(self, name: str, service: tuple[str, Any], request: Any, answered: Answered) -> None:
        """Send a request; `answered` gives the status once a response has arrived."""
        path, kind = service
        if path not in self._clients:
            where = f"/{self._namespace}/{path}".replace("//", "/")
            self._clients[path] = self._node.create_client(kind, where)

        def respond(future: Any) -> None:
            try:
                said = answered(future.result())
            except Exception as error:  # nobody else would report it
                said = f"{type(error).__name__}: {error}"
            if said:
                self._status = f"{name}: {said}"

        self._status = f"{name}: not answered yet"
        self._clients[path].call_async(request).add_done_callback(respond)


def _outcome(response: Any) -> str:
    outcome = decode_outcome(response)
    return "done" if outcome.success else f"rejected: {outcome.code} {outcome.reason}"
