"""Updates per second while learning, in one process or over the graph, beside updates alone."""

from __future__ import annotations

import argparse
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.learner import DESIGN, bare_updates, setting
from benchmarks.timing import Contender, measure
from pa_ros.acting.actor import Actor
from pa_ros.arena import ReachTask, design_named, preset_named, training_programs
from pa_ros.core.errors import PaError
from pa_ros.core.text import Report
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.loop import train
from pa_ros.tools.client import client_node
from pa_ros.tools.domain import use_free_domain
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import load_parameters, merged, packaged
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics

SAMPLES = 8  # rates of one graph; the learner publishes one per second
TIMEOUT_S = 90.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--network", default="programmable", help="networks' kind (%(default)s)")
    parser.add_argument(
        "--graph", action="store_true", help="the three nodes as processes, not one process"
    )


def run(options: argparse.Namespace) -> Report:
    """The share of the bare update rate that is left while learning 2-L."""
    bare = bare_updates(*setting(options.network))
    return graph_share(bare) if options.graph else process_share(options.network, bare)


class _Alternation:
    """Measures the same updates alone between parts of a training run."""

    def __init__(self, bare: Contender, slice_s: float) -> None:
        self.parts_s: list[float] = []
        self._bare, self._slice_s = bare, slice_s
        self._resumed = perf_counter()

    def __call__(self, _: Actor) -> dict[str, float]:
        """Takes the place of the evaluation in `train`, which calls it while the learner idles."""
        self.parts_s.append(perf_counter() - self._resumed)
        measure([self._bare], 1, self._slice_s)
        self._resumed = perf_counter()
        return {}


def process_share(
    kind: str, bare: Contender, rounds: int = 9, frames: int = 2000, slice_s: float = 0.5
) -> Report:
    """Medians over `rounds` parts of `frames` frames in one process; the first part is not counted.

    Each part lies between two measurements of `bare`.
    """
    network, config = setting(kind)
    arena, design = preset_named("fast"), design_named(DESIGN)
    alternation = _Alternation(bare, slice_s)
    with TemporaryDirectory() as folder:
        settings = TrainConfig(
            out=Path(folder),
            frames=(rounds + 1) * frames,
            evaluate_every_frames=frames,
            checkpoint_every_frames=0,
        )
        train(
            settings,
            network,
            config.changed(**{"replay.warmup_frames": 0}),
            ReachTask(arena, design, seed=0),
            np.array(arena.joint_speed_limits),
            training_programs(design),
            alternation,
        )
    rates = [frames / seconds for seconds in alternation.parts_s[1:]]
    bare_rate = median(s.calls / s.wall_s for s in bare.slices[1:]) * config.updates.per_frame
    return {
        "train.network": kind,
        "train.frames_per_s": median(rates),
        "train.bare_updates_per_s": bare_rate,
        "train.share_of_bare": median(rates) / bare_rate,
    }


def graph_share(bare: Contender, rounds: int = 5, bare_s: float = 2.0) -> Report:
    """Medians over `rounds` fresh graphs of three nodes, one update per frame, no evaluation.

    Each graph runs between two measurements of `bare`.
    """
    use_free_domain()

    def bare_rate() -> float:
        measure([bare], 1, bare_s)
        return bare.slices[-1].calls / bare.slices[-1].wall_s

    rates, shares, alone = [], [], [bare_rate()]
    for _ in range(rounds):
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
    figures, rates = GraphFigures(), [0.0]

    def sample() -> None:
        rate = figures.value("learner_node", "updates_per_s") or 0.0
        if rate != rates[-1]:
            rates.append(rate)

    # The first rate is 0, and in the next two seconds the learner may still have waited.
    wanted = 3 + SAMPLES
    with TemporaryDirectory() as name, Supervisor(Path(name)) as supervisor:
        with client_node("bench") as node:
            watch_diagnostics(node, figures)
            changes: dict[str, dict[str, Any]] = {
                "sim_node": {"eval_every_episodes": 0},
                "learner_node": {"out": f"{name}/run", "checkpoint_every_frames": 0},
            }
            parameters = merged(load_parameters(packaged("train_2l")), changes)
            start_nodes(supervisor, parameters, Path(name))
            if not watch(node, supervisor, sample, lambda: len(rates) >= wanted, TIMEOUT_S):
                raise PaError(
                    f"train: expected {wanted} rates of the learner in {TIMEOUT_S:g} s, got {rates}"
                )
    return median(rates[3:])
