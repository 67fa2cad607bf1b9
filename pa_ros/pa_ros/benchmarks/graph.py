"""What the graph costs: `pa_ros bench graph`."""

from __future__ import annotations

import statistics
import sys
import tempfile
from itertools import count
from pathlib import Path

from pa_ros.arena import ReachTask, RenderError, design_named, preset_named
from pa_ros.arena.render import render
from pa_ros.benchmarks.pingpong import measure_round_trips
from pa_ros.core.errors import PaError
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.tools.chaos.stage import with_key
from pa_ros.tools.client import Node, client_node
from pa_ros.tools.domain import use_domain
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import Parameters
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics
from pa_ros.wire.program import ProgramRequest, encode_program

SECONDS = 4.0  # of each measurement
TIMEOUT_S = 60.0
FLOOD_HZ = 1000.0  # programs a second
PARAMETERS: Parameters = {
    "sim_node": {"seed": 0},
    "agent_node": {"weights": "random"},
}


class BenchError(PaError):
    """A measurement that did not come about."""

    code = "bench"


def bench_graph(rounds: int = 3) -> dict[str, float | str]:
    """Lockstep control steps per second of sim_node and agent_node as two processes, no learner,
    beside a bare ping-pong of the same messages; each the median over `rounds` taken in turn.

    Of `graph.step_us`, a step's time: `graph.arena_us` and `graph.policy_us` by the nodes' own
    clocks; `graph.transport_us`, a bare round trip; `graph.waking_us`, by how much more a round
    trip costs when as much is computed in it (colder caches, threads and cores asleep); and
    `graph.nodes_us`, the rest: encoding, matching, bookkeeping. `graph.with_key_of_without`: the
    rate where nodes sign and check, as a share of the rate where they don't;
    `graph.flooded_of_quiet`: where someone sends FLOOD_HZ programs a second; and, where there is
    OpenGL, `graph.filmed_of_quiet`: where someone looks through the arena's camera.
    """
    use_domain(None)
    with_camera = _can_render()
    figures: dict[str, list[float]] = {}
    for _ in range(rounds):
        found = _graph()
        work_us = found["graph.arena_us"] + found["graph.policy_us"]
        found["graph.with_key_steps_per_s"] = _graph(signed=True)["graph.lockstep_steps_per_s"]
        found["graph.flooded_steps_per_s"] = _graph(flooded=True)["graph.lockstep_steps_per_s"]
        if with_camera:
            found["graph.filmed_steps_per_s"] = _graph(filmed=True)["graph.lockstep_steps_per_s"]
        found["graph.bare_pingpong_per_s"] = _bare()
        found["graph.working_pingpong_per_s"] = _bare(work_us)
        for name, value in found.items():
            figures.setdefault(name, []).append(value)
    middle = {name: statistics.median(values) for name, values in figures.items()}
    step_us = 1e6 / middle["graph.lockstep_steps_per_s"]
    bare_us = 1e6 / middle["graph.bare_pingpong_per_s"]
    working_us = 1e6 / middle["graph.working_pingpong_per_s"]
    core_us = middle["graph.arena_us"] + middle["graph.policy_us"]
    shares = {"with_key": "with_key_of_without", "flooded": "flooded_of_quiet"}
    shares |= {"filmed": "filmed_of_quiet"} if with_camera else {}
    quiet = middle["graph.lockstep_steps_per_s"]
    return {
        **middle,
        **{f"graph.{to}": middle[f"graph.{of}_steps_per_s"] / quiet for of, to in shares.items()},
        "graph.step_us": step_us,
        "graph.transport_us": bare_us,
        "graph.waking_us": working_us - core_us - bare_us,
        "graph.nodes_us": step_us - working_us,
        "graph.of_bare": bare_us / step_us,
        "graph.rounds": float(rounds),
    }


def _bare(work_us: float = 0.0) -> float:
    with tempfile.TemporaryDirectory() as folder, Supervisor(Path(folder)) as supervisor:
        supervisor.start("pingpong", [sys.executable, "-m", "pa_ros.benchmarks.pingpong"])
        with client_node("bench") as node:
            rate = measure_round_trips(node, SECONDS, TIMEOUT_S, work_us)
        supervisor.check()
    if rate == 0.0:
        raise BenchError(f"ping-pong: expected answers within {TIMEOUT_S:g} s, got none")
    return rate


def _flood(node: Node) -> None:
    publisher, numbers = topics.PROGRAM.publisher(node), count()

    def send() -> None:
        request = ProgramRequest(f"flood-{next(numbers)}", "NEAR(HAND, OR(RED, NOT(RED)))")
        publisher.publish(encode_program(request))

    steady_timer(node, 1.0 / FLOOD_HZ, send)


def _can_render() -> bool:
    task = ReachTask(preset_named("fast"), design_named("2-L"), seed=0)
    task.reset(0)
    try:
        render(task.simulation, 16, 16)
    except RenderError:
        return False
    return True


def _graph(signed: bool = False, flooded: bool = False, filmed: bool = False) -> dict[str, float]:
    rates: list[tuple[float, float, float]] = []
    figures = GraphFigures()

    def sample() -> None:
        values = [
            figures.value(node, key)
            for node, key in (
                ("sim_node", "steps_per_s"),
                ("sim_node", "core_us"),
                ("agent_node", "core_us"),
            )
        ]
        rate, arena, policy = (value or 0.0 for value in values)
        if rate > 0.0 and policy > 0.0 and (not rates or rates[-1] != (rate, arena, policy)):
            rates.append((rate, arena, policy))

    with tempfile.TemporaryDirectory() as folder, Supervisor(Path(folder)) as supervisor:
        with client_node("bench") as node:
            watch_diagnostics(node, figures)
            if flooded:
                _flood(node)
            given = with_key(PARAMETERS, Path(folder)) if signed else PARAMETERS
            if filmed:
                topics.CAMERA_IMAGE.subscribe(node, lambda _picture: None)
                given = {**given, "sim_node": {**given["sim_node"], "camera.rate_hz": 10.0}}
            start_nodes(supervisor, given, Path(folder))
            wanted = 2 + int(SECONDS)  # the first is of the start, in part
            if not watch(node, supervisor, sample, lambda: len(rates) >= wanted, TIMEOUT_S):
                raise BenchError(f"graph: expected steps within {TIMEOUT_S:g} s, got too few")
    rate, arena, policy = (statistics.median(column) for column in zip(*rates[2:], strict=True))
    return {
        "graph.lockstep_steps_per_s": rate,
        "graph.arena_us": arena,
        "graph.policy_us": policy,
    }
