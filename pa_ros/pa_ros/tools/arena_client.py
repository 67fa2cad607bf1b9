"""Asking an arena for a scene, or to stand still: its services, with bounds and typed errors."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node

from pa_ros.core.errors import PaError
from pa_ros.ros.executor import spin_until
from pa_ros.ros.topics import RESET, SET_SIMULATION_STATE
from pa_ros.wire.services import Outcome, ResetRequest, decode_outcome, encode_reset
from pa_ros.wire.simulator import SimState, encode_state_request

Spin = Callable[[Callable[[], bool], float], bool]


class ArenaServiceError(PaError):
    """A service of the arena that was refused, with its cause, or that did not answer in time."""

    code = "arena.service"


class ArenaSilentError(ArenaServiceError):
    """No arena offers the service, or it did not answer in time."""

    code = "arena.silent"


class ArenaClient:
    """The services of the arena in a node's namespace, or in one below it."""

    def __init__(self, node: Node, spin: Spin | None = None, namespace: str = "") -> None:
        """`spin` serves callbacks until a condition holds or a time is up; whether it holds."""
        self._spin = spin or partial(spin_until, node)
        below = f"{namespace}/" if namespace else ""
        self._reset = node.create_client(RESET[1], below + RESET[0])
        self._state = node.create_client(SET_SIMULATION_STATE[1], below + SET_SIMULATION_STATE[0])

    def reset(self, request: ResetRequest, timeout_s: float) -> Outcome:
        """Begin an episode; where the arena then stands. Raises ArenaServiceError."""
        return self._call("reset", self._reset, encode_reset(request), timeout_s)

    def pause(self, paused: bool, timeout_s: float) -> Outcome:
        """Stop the arena's time, or let it go on. Raises ArenaServiceError."""
        state = SimState.PAUSED if paused else SimState.PLAYING
        request = encode_state_request(state)
        return self._call(SET_SIMULATION_STATE[0], self._state, request, timeout_s)

    def _call(self, name: str, client: Any, request: Any, timeout_s: float) -> Outcome:
        if not self._spin(client.service_is_ready, timeout_s):
            raise ArenaSilentError(f"{name}: no arena offers it within {timeout_s:g} s")
        answer = client.call_async(request)
        if not self._spin(answer.done, timeout_s):
            raise ArenaSilentError(f"{name}: no answer within {timeout_s:g} s")
        outcome = decode_outcome(answer.result())
        if not outcome.success:
            raise ArenaServiceError(f"{name}: refused: [{outcome.code}] {outcome.reason}")
        return outcome
