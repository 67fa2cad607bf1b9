"""Control steps per second of an arena and an agent as two processes, and where the time goes."""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from rclpy.node import Node

from laboratory.benchmarks.pingpong import measure_round_trips, physics_and_networks
from pa_ros.core.errors import PaError
from pa_ros.core.text import Report
from pa_ros.tools.client import client_node
from pa_ros.tools.domain import use_free_domain
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import Parameters
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics
from pa_ros.wire.signing import KEY_BYTES

SECONDS = 4.0  # of each measurement
TIMEOUT_S = 60.0
PARAMETERS: Parameters = {"sim_node": {"seed": 0}, "agent_node": {"weights": "random"}}
RATE, ARENA, POLICY = "graph.lockstep_steps_per_s", "graph.arena_us", "graph.policy_us"
FIXED = "graph.fixed_pingpong_per_s"
SOURCES = {
    RATE: ("sim_node", "steps_per_s"),
    ARENA: ("sim_node", "core_us"),
    POLICY: ("agent_node", "core_us"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--rounds", type=int, default=3, help="of each measurement (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Medians over rounds; graphs and ping-pongs of the same messages take turns.

    `arena_us` and `policy_us` are parts of a step's time by the nodes' own clocks.
    `of_fixed_pingpong` is the rate as a share of a ping-pong's that computes the physics and the
    networks alone, so it falls if arena, policy or nodes become slower. `composed_steps_per_s` is
    the rate of both nodes in one process; `with_key_of_without` the rate with signed messages as a
    share of the rate without.
    """
    use_free_domain()
    figures: dict[str, list[float]] = {}
    for _ in range(options.rounds):
        found = lockstep(PARAMETERS)
        found["graph.composed_steps_per_s"] = lockstep(PARAMETERS, compose=True)[RATE]
        with tempfile.TemporaryDirectory() as folder:
            key = Path(folder) / "key"
            key.touch(mode=0o600)
            key.write_bytes(os.urandom(KEY_BYTES))
            signed = {name: {**values, "auth_key_file": str(key)}
                      for name, values in PARAMETERS.items()}  # fmt: skip
            found["graph.with_key_steps_per_s"] = lockstep(signed)[RATE]
        found[FIXED] = pingpong()
        for name, value in found.items():
            figures.setdefault(name, []).append(value)
    middle = {name: statistics.median(values) for name, values in figures.items()}
    return {
        **middle,
        "graph.with_key_of_without": middle["graph.with_key_steps_per_s"] / middle[RATE],
        "graph.of_fixed_pingpong": middle[RATE] / middle[FIXED],
        "graph.rounds": options.rounds,
    }


def lockstep(parameters: Parameters, compose: bool = False) -> dict[str, float]:
    """Steps per second, and the arena's and the policy's time in a step, of one fresh graph."""
    samples: list[dict[str, float]] = []

    def sample(figures: GraphFigures) -> None:
        found = {name: figures.value(*source) or 0.0 for name, source in SOURCES.items()}
        if found[RATE] and found[POLICY] and found not in samples[-1:]:
            samples.append(found)

    wanted = 2 + int(SECONDS)  # the first two are partly of the start
    run_graph(parameters, sample, lambda: len(samples) >= wanted, TIMEOUT_S, compose)
    return {name: statistics.median(s[name] for s in samples[2:]) for name in SOURCES}


def run_graph(
    parameters: Parameters,
    sample: Callable[[GraphFigures], None],
    finished: Callable[[], bool],
    timeout_s: float,
    compose: bool = False,
    listen: Callable[[Node], object] = lambda node: None,
) -> None:
    """Run a fresh graph, and sample its figures again and again, until `finished`.

    `listen` subscribes before the graph starts. Raises PaError if it takes longer than `timeout_s`.
    """
    figures = GraphFigures()
    with tempfile.TemporaryDirectory() as folder, Supervisor(Path(folder)) as supervisor:
        with client_node("bench") as node:
            watch_diagnostics(node, figures)
            listen(node)
            start_nodes(supervisor, parameters, Path(folder), compose=compose)
            if not watch(node, supervisor, lambda: sample(figures), finished, timeout_s):
                raise PaError(f"graph: expected its figures within {timeout_s:g} s, got too few")


def pingpong() -> float:
    """Round trips per second with a process that only answers."""
    command = [sys.executable, "-m", "laboratory.benchmarks.pingpong"]
    physics, _ = physics_and_networks()
    with tempfile.TemporaryDirectory() as folder, Supervisor(Path(folder)) as supervisor:
        supervisor.start("pingpong", command)
        with client_node("bench") as node:
            rate = measure_round_trips(node, physics, SECONDS, TIMEOUT_S)
        supervisor.check()
    if rate == 0.0:
        raise PaError(f"ping-pong: expected answers within {TIMEOUT_S:g} s, got none")
    return rate
