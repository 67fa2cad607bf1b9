"""Updates per second of a graph that learns, as a share of the bare update rate."""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pa_ros.core.errors import PaError
from pa_ros.core.report import Report
from pa_ros.tools.client import client_node
from pa_ros.tools.domain import use_domain
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import load_parameters, merged, packaged
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics

SECONDS = 8  # of each measurement; the learner says its rate once a second
TIMEOUT_S = 90.0


class GraphLearningError(PaError):
    """A graph that did not learn in time."""

    code = "bench.learning"


def bench_learning_graph(bare: Callable[[], float], rounds: int = 5) -> Report:
    """Medians over `rounds` of a fresh graph of three nodes (design 2-L, one update per frame, no
    evaluation), each between two measurements of `bare`, updates per second without a graph.
    """
    use_domain(None)
    rates, shares, alone = [], [], [bare()]
    for _ in range(rounds):
        rates.append(_graph())
        alone.append(bare())
        shares.append(2.0 * rates[-1] / (alone[-2] + alone[-1]))
    return {
        "graph.updates_per_s": statistics.median(rates),
        "graph.updates_per_s_low": min(rates),
        "graph.updates_per_s_high": max(rates),
        "graph.bare_updates_per_s": statistics.median(alone),
        "graph.share_of_bare": statistics.median(shares),
    }


def _graph() -> float:
    """The median second of a learning graph, updates per second."""
    figures, rates = GraphFigures(), [0.0]

    def sample() -> None:
        rate = figures.value("learner_node", "updates_per_s") or 0.0
        if rate != rates[-1]:
            rates.append(rate)

    wanted = 3 + SECONDS  # a 0, and two seconds in which the learner may still have waited
    with tempfile.TemporaryDirectory() as name, Supervisor(Path(name)) as supervisor:
        with client_node("bench") as node:
            watch_diagnostics(node, figures)
            changes: dict[str, dict[str, Any]] = {
                "sim_node": {"eval_every_episodes": 0},
                "learner_node": {"out": f"{name}/run", "checkpoint_every_frames": 0},
            }
            parameters = merged(load_parameters(packaged("train_2l")), changes)
            start_nodes(supervisor, parameters, Path(name))
            if not watch(node, supervisor, sample, lambda: len(rates) >= wanted, TIMEOUT_S):
                raise GraphLearningError(
                    f"graph: expected {wanted} rates within {TIMEOUT_S:g} s, got {rates}"
                )
    return statistics.median(rates[3:])
