"""How sharply detectors should speak where agents execute, chosen on agents of no other table.

The same agents act with the logits of their detectors multiplied by several factors. Scores are
shares of episodes that end satisfied.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from statistics import fmean

from pa_ros.core.text import Report
from pa_ros.evaluation.agents import load_agent
from pa_ros.evaluation.scorer import Benchmark, Scorer
from pa_ros.language import MIN_MAX

CONDITIONS = ("eval", "blocks-8", "ignore-new", "reach-new-both", "depth-6", "several-3")
FACTORS = (1.0, 1.5, 2.5, 4.0, 6.0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("runs", nargs="+", type=Path, help="trained agents of one design")
    parser.add_argument("--factors", nargs="+", type=float, default=FACTORS, metavar="X")
    parser.add_argument("--episodes", type=int, default=100, help="per condition (%(default)s)")
    parser.add_argument("--scores", type=Path, default=Path("runs/experiments/scores"),
                        help="folder in which scores are stored (%(default)s)")  # fmt: skip


def run(options: argparse.Namespace) -> Report:
    """Score all agents by each factor."""
    found: dict[str, float | int | str] = {}
    for factor in options.factors:
        logic = replace(MIN_MAX, sharpness=factor)
        agents = [load_agent(path, logic=logic) for path in options.runs]
        first = agents[0]
        scorer = Scorer(Benchmark(first.design, first.arena, options.episodes), options.scores)
        means = []
        for condition in CONDITIONS:
            shares = [
                fmean(score.success for score in scorer.agent(agent, condition)) for agent in agents
            ]
            means.append(fmean(shares))
            found[f"sharpness.{factor:g}.{condition}"] = means[-1]
            found[f"sharpness.{factor:g}.{condition}.worst_agent"] = min(shares)
        found[f"sharpness.{factor:g}.mean"] = fmean(means)
    return found
