"""Learning on design 2-L: updates beside peers, the loop in one process and over the graph."""

from __future__ import annotations

import sys
from importlib.metadata import version
from pathlib import Path

import gymnasium
import numpy as np

from pa_ros.arena import ReachTask, design_named, preset_named, training_programs, world_of
from pa_ros.arena.gym_env import ENV_ID
from pa_ros.benchmarks.growth import bench_growth, markdown_table
from pa_ros.benchmarks.growth_figure import growth_figure
from pa_ros.benchmarks.learner import bare_updates, bench_learner
from pa_ros.benchmarks.rounds import Contender, measure
from pa_ros.benchmarks.training import bench_train
from pa_ros.core.report import Report
from pa_ros.language import Program
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.protocols import protocol_named
from pa_ros.networks.config import NetworkConfig

DESIGN = "2-L"
BARE_S = 2.0  # of bare updates between graphs


def bench_updates(kind: str) -> Report:
    """`pa_ros bench learner`: one run of everything, for networks of a kind.

    One thread unless a name says otherwise; one program a transition.
    """
    network, config, programs = _setting(kind)
    peers, facts = installed_peers()
    report = bench_learner(network, config, programs, others=peers)
    return {**report, **facts}


def bench_growing(kind: str, picture: Path | None) -> Report:
    """`pa_ros bench learner --growth`: the table on standard output, and a picture if asked for."""
    network, config, programs = _setting(kind)
    report = bench_growth(network, config, programs)
    print(markdown_table(report))
    if picture is not None:
        growth_figure(picture, report)
    return report


def bench_loop(kind: str) -> Report:
    """`pa_ros bench train`: arena, actor and learner in one process, as `pa_ros train` has them."""
    design, arena, protocol = design_named(DESIGN), preset_named("fast"), protocol_named("ours")
    report = bench_train(
        protocol.network_config(world_of(arena, design), kind),
        protocol.learner,
        training_programs(design),
        ReachTask(arena, design, seed=0),
        np.array(arena.joint_speed_limits),
    )
    return {**report, "train.network": kind, "train.design": DESIGN}


def bench_graph_loop(kind: str) -> Report:
    """`pa_ros bench train --graph`: the same over the graph, three processes."""
    from pa_ros.benchmarks.graph_learning import bench_learning_graph

    design, protocol = design_named(DESIGN), protocol_named("ours")
    network = protocol.network_config(world_of(preset_named("fast"), design), kind)
    bare = bare_updates(network, protocol.learner, training_programs(design))

    def updates_per_s() -> float:
        measure([bare], 1, BARE_S)
        part = bare.slices[-1]
        return part.calls / part.wall_s

    return {**bench_learning_graph(updates_per_s), "graph.design": DESIGN}


def _setting(kind: str) -> tuple[NetworkConfig, LearnerConfig, tuple[Program, ...]]:
    design, protocol = design_named(DESIGN), protocol_named("ours")
    network = protocol.network_config(world_of(preset_named("fast"), design), kind)
    config = protocol.learner.changed(**{"relabeling.programs_per_transition": 1})
    return network, config, training_programs(design)


def installed_peers() -> tuple[list[Contender], dict[str, str]]:
    """Stable-Baselines3 and SBX if they are installed, and what the report says of them."""
    from pa_ros.benchmarks.sb3 import sb3_contender, sbx_contender

    peers, facts = list[Contender](), dict[str, str]()
    for name, package, make in (
        ("sb3", "stable-baselines3", sb3_contender),
        ("sbx", "sbx-rl", sbx_contender),
    ):
        try:
            peers.append(make(gymnasium.make(ENV_ID, design=DESIGN)))
            facts[f"learner.{name}"] = f"{package} {version(package)}"
        except ImportError as error:
            print(f"{package} is left out: {error} (make install-peers)", file=sys.stderr)
            facts[f"learner.{name}"] = "not installed"
    return peers, facts
