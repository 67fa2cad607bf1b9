"""Run a graph: start its nodes as child processes, and watch them from a node beside them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rclpy.node import Node

from pa_ros.core.errors import ConfigError, PaError
from pa_ros.ros.executor import spin_until, steady_timer
from pa_ros.tools.launch_params import NODES, Parameters, merged, write_parameters
from pa_ros.tools.launcher import Supervisor, node_command
from pa_ros.tools.monitor import REFRESH_S

DISCOVERY_S = 3.5  # until nodes have found each other: DDS announces itself every 3 s


def start_nodes(
    supervisor: Supervisor,
    parameters: Parameters,
    folder: Path,
    namespace: str = "",
    compose: bool = False,
) -> dict[str, int]:
    """Write `folder`/params.yaml and start every node in it; return process ids by node.

    A node in a namespace of its own (`arena1/agent_node`) is the process `arena1.agent_node`, and
    its learner is the one of `namespace`. With `compose`, an arena and its agent share one
    process, `arena1.sim_node+agent_node`.

    Agents start last, after the nodes that they wait for; no start waits for another process.
    """
    path = folder / "params.yaml"
    processes: dict[str, int] = {}
    above = f"/{namespace.strip('/')}"
    if "learner_node" in parameters:
        agents = [place for place in parameters if place.endswith("/agent_node")]
        parameters = merged(parameters, {place: {"learner": above} for place in agents})
    write_parameters(path, parameters, namespace)
    groups: dict[str, list[str]] = {}  # by process
    for place in sorted(parameters, key=lambda place: NODES.index(place.rpartition("/")[2])):
        within, _, name = place.rpartition("/")
        shares = compose and name != "learner_node"
        groups.setdefault(f"{within}/" if shares else place, []).append(place)
    for places in groups.values():
        within = places[0].rpartition("/")[0]
        names = [place.rpartition("/")[2] for place in places]
        title = f"{within}/{'+'.join(names)}".strip("/").replace("/", ".")
        process = supervisor.start(title, node_command(names, path, f"{above}/{within}"))
        processes |= dict.fromkeys(places, process)
    return processes


def refuse_running(node: Node, parameters: Parameters) -> None:
    """Raise ConfigError if one of the nodes runs already; takes DISCOVERY_S if none does."""
    spin_until(node, lambda: bool(present(node, parameters)), DISCOVERY_S)
    if occupied := present(node, parameters):
        raise ConfigError(
            f"{', '.join(sorted(occupied))} already in the graph of ROS domain "
            f"{node.context.get_domain_id()}, namespace {node.get_namespace()}: choose another "
            "namespace or ROS_DOMAIN_ID (a node that was killed vanishes within half a minute)"
        )


def present(node: Node, parameters: Parameters) -> set[str]:
    """The nodes of `parameters` that are in the graph, in the namespace of `node` or below."""
    above = node.get_namespace().rstrip("/")
    seen = {f"{where.rstrip('/')}/{name}" for name, where in node.get_node_names_and_namespaces()}
    return {place for place in parameters if f"{above}/{place}" in seen}


def watch(
    node: Node,
    supervisor: Supervisor,
    refresh: Callable[[], None],
    finished: Callable[[], bool],
    timeout_s: float | None = None,
) -> bool:
    """Spin and refresh a display until `finished` or for `timeout_s`; whether it finished.

    Raises ChildError as soon as a child has ended by itself.
    """
    failure: list[PaError] = []

    def tick() -> None:
        refresh()
        try:
            supervisor.check()
        except PaError as error:
            failure.append(error)

    timer = steady_timer(node, REFRESH_S, tick)
    try:
        spin_until(node, lambda: bool(failure) or finished(), timeout_s)
    finally:
        node.destroy_timer(timer)
    if failure:
        raise failure[0]
    return finished()
