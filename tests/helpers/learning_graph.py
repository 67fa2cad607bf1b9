"""A graph of real processes that learns until a version of the weights is heard."""

from __future__ import annotations

from pathlib import Path

from helpers.waiting import DEADLINE_S
from pa_ros.core.experience import PolicySnapshot
from pa_ros.ros import topics
from pa_ros.tools.client import client_node
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import Parameters
from pa_ros.tools.launcher import Supervisor
from pa_ros.wire import codec
from pa_ros.wire.interfaces import Message
from pa_ros.wire.records import ArenaDescription


def learned_over_the_graph(
    folder: Path, given: Parameters, version: int
) -> tuple[PolicySnapshot, ArenaDescription]:
    """The first policy heard of at least a version, and what the arena said of itself.

    The graph doesn't wait for this watcher: on a busy machine a version can have passed before
    the watcher is discovered.
    """
    policies: list[PolicySnapshot] = []
    arenas: list[ArenaDescription] = []

    def receive(message: Message) -> None:
        snapshot = codec.decode_weights(message).snapshot
        if snapshot.version >= version:
            policies.append(snapshot)

    with Supervisor(folder) as supervisor, client_node("watch") as node:
        topics.POLICY_WEIGHTS.subscribe(node, receive)
        topics.ARENA_INFO.subscribe(node, lambda m: arenas.append(codec.decode_arena_info(m)))
        start_nodes(supervisor, given, folder)
        heard = lambda: bool(policies and arenas)  # noqa: E731
        assert watch(node, supervisor, lambda: None, heard, DEADLINE_S)
    return policies[0], arenas[0]
