"""A command-line tool on the graph: its node, and the services of an arena that it calls."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from numbers import Integral
from typing import Any

import numpy as np
from rclpy.node import Node

from pa_ros.core.errors import PaError
from pa_ros.core.experience import Body, Float64
from pa_ros.ros.environment import check_namespace, prepare_environment, start_ros
from pa_ros.ros.executor import release, spin_until
from pa_ros.ros.topics import (
    ARENA_INFO,
    GET_ENTITIES_STATES,
    RESET,
    RESUME,
    SCATTER,
    SET_ENTITY_STATE,
    SET_SIMULATION_STATE,
    SPEED,
    Topic,
)
from pa_ros.wire.services import (
    Outcome,
    ResetRequest,
    decode_outcome,
    decode_triggered,
    encode_reset,
    encode_speed,
    encode_trigger,
)
from pa_ros.wire.simulator import (
    SimState,
    decode_places,
    encode_state_change,
    encode_state_request,
)

__all__ = ["ArenaClient", "NoAnswerError", "Node", "client_node"]

SERVICES = (RESET, SET_SIMULATION_STATE, SPEED, GET_ENTITIES_STATES, SET_ENTITY_STATE, SCATTER,
            RESUME)  # fmt: skip
Spin = Callable[[Callable[[], bool], float], bool]
"""Spins until a condition is true or a time in seconds is over; whether it became true."""


class NoAnswerError(PaError):
    """Nobody on the graph answered in time."""

    code = "send.timeout"


@contextmanager
def client_node(name: str, namespace: str = "", domain: int | None = None) -> Iterator[Node]:
    """Make a node named `<name>_<pid>` with ROS of its own; end both afterwards.

    Other nodes of the process are not concerned. Signals keep their handlers. Raises ConfigError
    for a namespace that ROS rejects.

    :param domain: the ROS domain; None: ROS_DOMAIN_ID, or 0.
    """
    prepare_environment()
    import rclpy
    from rclpy.context import Context

    check_namespace(namespace.strip("/"))
    context = Context()
    start_ros([], context, domain)
    try:
        node = rclpy.create_node(
            f"{name}_{os.getpid()}",
            context=context,
            namespace=f"/{namespace.strip('/')}",
            enable_rosout=False,
            start_parameter_services=False,
        )
        try:
            yield node
        finally:
            release(node)
            node.destroy_node()
    finally:
        context.try_shutdown()


def namespaces_of_arenas(node: Node) -> tuple[str, ...]:
    """Namespaces in which an arena describes itself; `/` is the root."""
    name = f"/{ARENA_INFO.name}"
    return tuple(sorted(
        topic.removesuffix(name) or "/"
        for topic, _ in node.get_topic_names_and_types()
        if topic.endswith(name) and node.count_publishers(topic)
    ))  # fmt: skip


def publishers_of(node: Node, topic: Topic) -> set[str]:
    """Full names of the nodes that publish a topic, as far as they have been discovered."""
    return {
        f"{info.node_namespace.rstrip('/')}/{info.node_name}"
        for info in node.get_publishers_info_by_topic(topic.name)
    }


class ArenaClient:
    """The services of the arena in a node's namespace, or in one below it."""

    def __init__(
        self, node: Node, timeout_s: float, spin: Spin | None = None, namespace: str = ""
    ) -> None:
        self._timeout_s, self._spin = timeout_s, spin or partial(spin_until, node)
        below = f"{namespace}/" if namespace else ""
        self._clients = {name: node.create_client(kind, below + name) for name, kind in SERVICES}

    def reset(self, request: ResetRequest) -> Outcome:
        """Begin an episode; episode and step then. Raises NoAnswerError, PaError if rejected."""
        return self._call(RESET[0], encode_reset(request))

    def pause(self, paused: bool) -> Outcome:
        """Stop or resume simulation time. Raises NoAnswerError, PaError if rejected."""
        state = SimState.PAUSED if paused else SimState.PLAYING
        request = encode_state_request(state)
        return self._call(SET_SIMULATION_STATE[0], request)

    def set_speed(self, times: float) -> None:
        """Change the speed, times real time. Raises NoAnswerError, PaError if rejected."""
        self._call(SPEED[0], encode_speed(times))

    def move(self, block: int, x: float, y: float, places: Float64 | None = None) -> None:
        """Put a block, by its number, somewhere on the table (m). Raises NoAnswerError, PaError if
        rejected.

        :param places: [N, 3] m; cameras number blocks in an order of their own, so the block is
            meant that is nearest to its place there. None: numbers are the arena's.
        """
        name, states = GET_ENTITIES_STATES
        names, positions = decode_places(self._answer(name, states.Request()))
        there = positions[1:]  # without the hand
        count = len(there if places is None else places)
        if not isinstance(block, Integral) or not 0 <= block < count:
            text = f"move: expected one of {count} blocks, got number {block!r}"
            raise PaError(text, code="arena.service")
        if places is not None:
            block = int(np.linalg.norm(there - places[block], axis=1).argmin())
        place = Body.at_rest(np.array([x, y, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))
        request = encode_state_change(names[1 + block], place)
        self._call(SET_ENTITY_STATE[0], request)

    def scatter(self) -> str:
        """Let a robot that learns stop for a person to scatter the blocks; what it says. Raises
        NoAnswerError, PaError if rejected."""
        return self._trigger(SCATTER[0])

    def scattered(self) -> str:
        """Let it continue with the blocks as they are now; what it says. Raises as `scatter`."""
        return self._trigger(RESUME[0])

    def _trigger(self, name: str) -> str:
        done, told = decode_triggered(self._answer(name, encode_trigger()))
        if not done:
            raise PaError(f"{name}: rejected: {told}", code="arena.service")
        return told

    def _answer(self, name: str, request: Any) -> Any:
        client, timeout_s = self._clients[name], self._timeout_s
        if not self._spin(client.service_is_ready, timeout_s):
            raise NoAnswerError(
                f"{name}: no arena offers it within {timeout_s:g} s", code="arena.silent"
            )
        answer = client.call_async(request)
        if not self._spin(answer.done, timeout_s):
            raise NoAnswerError(f"{name}: no answer within {timeout_s:g} s", code="arena.silent")
        return answer.result()

    def _call(self, name: str, request: Any) -> Outcome:
        outcome = decode_outcome(self._answer(name, request))
        if not outcome.success:
            text = f"{name}: rejected: [{outcome.code}] {outcome.reason}"
            raise PaError(text, code="arena.service")
        return outcome
