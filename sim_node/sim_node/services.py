"""The arena's own services: reset and speed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from rclpy.node import Node

from pa_ros.core.errors import PaError
from pa_ros.ros import topics
from pa_ros.ros.refusals import Refusals
from pa_ros.wire import Message
from pa_ros.wire.services import (
    Outcome,
    ResetRequest,
    decode_reset,
    decode_speed,
    encode_outcome,
)
from sim_node.session import Session


class ArenaControl(Protocol):
    """What the node does for its services."""

    session: Session
    paused: bool
    active: bool

    def check_active(self) -> None:
        """Raise SimError unless the arena is active."""

    def begin(self, request: ResetRequest) -> None:
        """Begin an episode."""

    def hold(self, steps: int) -> None:
        """Let so many control periods pass while the arm holds still. SimError."""

    def pause(self, paused: bool) -> None:
        """Stop time, or let it go on."""

    def set_speed(self, factor: float) -> None:
        """Simulation time per wall time from now on. SimError."""

    @property
    def speed(self) -> float:
        """Simulation time per wall time; 0 in lockstep."""


class ArenaServices:
    """Offers them on a node, in its namespace."""

    def __init__(self, node: Node, arena: ArenaControl, refusals: Refusals) -> None:
        self._arena, self._refusals = arena, refusals
        services: list[tuple[tuple[str, Any], Callable[[Message], None]]] = [
            (topics.RESET, lambda m: arena.begin(decode_reset(m))),
            (topics.SPEED, lambda m: arena.set_speed(decode_speed(m))),
        ]
        for (name, kind), act in services:
            node.create_service(kind, name, self._answering(name, act), qos_profile=topics.SERVICE)

    def _answering(
        self, name: str, act: Callable[[Message], None]
    ) -> Callable[[Message, Message], Message]:
        """A service that answers a refusal with its cause."""

        def answer(request: Message, response: Message) -> Message:
            try:
                self._arena.check_active()
                act(request)
                outcome = self._outcome(True)
            except PaError as error:
                self._refusals.refuse(name, error)
                outcome = self._outcome(False, error.code, str(error))
            return Message(encode_outcome(response, outcome))

        return answer

    def _outcome(self, success: bool, code: str = "", reason: str = "") -> Outcome:
        stands = self._arena.session.frame.observation
        return Outcome(success, code, reason, stands.episode, stands.stamp_ns, self._arena.speed)
