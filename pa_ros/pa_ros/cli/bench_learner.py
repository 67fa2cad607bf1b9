"""`pa_ros bench learner`: the learner on design 2-L, beside its peers."""

from __future__ import annotations

import argparse
import sys
from importlib.metadata import version

import gymnasium

from pa_ros.arena.designs import design_named
from pa_ros.arena.gym_env import ENV_ID
from pa_ros.core.report import Report
from pa_ros.evaluation.training import training_programs
from pa_ros.learning.bench import bench_learner
from pa_ros.learning.bench_rounds import Contender
from pa_ros.learning.protocols import protocol_named

DESIGN = "2-L"


def bench(options: argparse.Namespace) -> Report:
    """One run of everything, one thread unless a name says otherwise."""
    design, protocol = design_named(DESIGN), protocol_named("ours")
    network = protocol.network_config(design.vocabulary, options.network)
    peers, facts = _peers()
    report = bench_learner(network, protocol.learner, training_programs(design), others=peers)
    return {**report, **facts}


def _peers() -> tuple[list[Contender], dict[str, str]]:
    """Stable-Baselines3 if it is installed, and what the report says of it."""
    name = "learner.sb3"
    try:
        from pa_ros.learning.bench_sb3 import sb3_contender

        peer = sb3_contender(gymnasium.make(ENV_ID, design=DESIGN))
    except ImportError as error:
        print(f"Stable-Baselines3 is left out: {error} (make install-bench)", file=sys.stderr)
        return [], {name: "not installed"}
    return [peer], {name: f"stable-baselines3 {version('stable-baselines3')}"}
