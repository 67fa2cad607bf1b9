"""Updates per second while learning over the graph, beside updates alone."""

from __future__ import annotations

import argparse
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from laboratory.benchmarks.graph import run_graph
from laboratory.benchmarks.learner import bare_updates, setting
from laboratory.benchmarks.timing import measure
from pa_ros.core.text import Report
from pa_ros.tools.domain import use_free_domain
from pa_ros.tools.launch_params import load_parameters, merged, packaged
from pa_ros.tools.monitor import GraphFigures

SAMPLES = 8  # rates of one graph; the learner publishes one per second
TIMEOUT_S = 90.0
BARE_S = 2.0  # of one measurement of updates alone


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--rounds", type=int, default=5, help="fresh graphs (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Medians over fresh graphs of three nodes, one update per frame, no evaluation.

    Each graph runs between two measurements of the same updates alone.
    """
    use_free_domain()
    bare = bare_updates(*setting("programmable"))

    def bare_rate() -> float:
        measure([bare], 1, BARE_S)
        return bare.slices[-1].calls / bare.slices[-1].wall_s

    rates, shares, alone = [], [], [bare_rate()]
    for _ in range(options.rounds):
        rates.append(_graph_rate())
        alone.append(bare_rate())
        shares.append(2.0 * rates[-1] / (alone[-2] + alone[-1]))
    return {
        "graph.updates_per_s": median(rates),
        "graph.bare_updates_per_s": median(alone),
        "graph.share_of_bare": median(shares),
    }


def _graph_rate() -> float:
    """The median over some seconds of a learning graph, updates per second."""
    rates = [0.0]

    def sample(figures: GraphFigures) -> None:
        rate = figures.value("learner_node", "updates_per_s") or 0.0
        if rate != rates[-1]:
            rates.append(rate)

    # The first rate is 0, and in the next two seconds the learner may still have waited.
    wanted = 3 + SAMPLES
    with TemporaryDirectory() as name:
        changes: dict[str, dict[str, Any]] = {
            "sim_node": {"eval_every_episodes": 0},
            "learner_node": {"out": f"{name}/run", "checkpoint_every_frames": 0},
        }
        parameters = merged(load_parameters(packaged("train_2l")), changes)
        run_graph(parameters, sample, lambda: len(rates) >= wanted, TIMEOUT_S)
    return median(rates[3:])
