"""Launches nodes so that a recorder in its own process receives everything from the first step."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from rclpy.node import Node

from pa_ros.bags.errors import BagError
from pa_ros.ros import topics
from pa_ros.tools.client import ArenaClient
from pa_ros.tools.graph import DISCOVERY_S, present, start_nodes, watch
from pa_ros.tools.launch_params import Parameters, merged
from pa_ros.tools.launcher import Supervisor

RECORDER: Final = "recorder"  # its name among the processes of a launch
READY_S: Final = 30.0


def start_recorder(
    supervisor: Supervisor,
    node: Node,
    folder: Path,
    namespace: str = "",
    arenas: Sequence[str] = (),
) -> None:
    """Record everything in another process; return once it has subscribed.

    Raises ChildError, or BagError if it has not subscribed in READY_S.
    """
    command = [sys.executable, "-m", "pa_ros", "record", str(folder), "--namespace", namespace]
    command += ["--arenas", *arenas] if arenas else []
    supervisor.start(RECORDER, command)
    probe = topics.TRAJECTORIES.publisher(node)
    ready = watch(
        node, supervisor, lambda: None, lambda: probe.get_subscription_count() > 0, READY_S
    )
    node.destroy_publisher(probe)
    if not ready:
        raise BagError(f"record: the recorder did not subscribe within {READY_S:g} s")


def start_recorded(
    supervisor: Supervisor,
    node: Node,
    parameters: Parameters,
    folder: Path,
    compose: bool = False,
) -> None:
    """Start nodes in the namespace of `node`, so that a recorder misses nothing of theirs.

    Their arenas are paused until all processes have discovered each other: a message is lost to
    subscribers that its publisher has not discovered. Raises ChildError, or BagError if a node does
    not appear in READY_S.
    """
    held = [
        place
        for place, values in parameters.items()
        if place.endswith("sim_node") and not values.get("paused", False)
    ]
    changes = {place: {"paused": True} for place in held}
    held_back = merged(parameters, changes)
    start_nodes(supervisor, held_back, folder, node.get_namespace(), compose)

    def gathered() -> bool:
        return present(node, parameters) == set(parameters)

    if not watch(node, supervisor, lambda: None, gathered, READY_S):
        raise BagError(f"record: not all of {', '.join(parameters)} appeared within {READY_S:g} s")
    if held:
        watch(node, supervisor, lambda: None, lambda: False, DISCOVERY_S)
    for place in held:
        ArenaClient(node, READY_S, namespace=place.rpartition("/")[0]).pause(False)
