"""`pa_ros eval`: score a checkpoint, or a reference policy, under a condition."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

import numpy as np

from pa_ros.arena import ArenaConfig, design_named, preset_named
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float64, Observation
from pa_ros.core.report import Report, device, versions, write_report
from pa_ros.evaluation.evaluate import (
    REFERENCES,
    AgentPolicy,
    Evaluation,
    by_program,
    evaluate,
)
from pa_ros.learning.actor import Actor
from pa_ros.learning.checkpoint import load_policy, read_metadata


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros eval`."""
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--checkpoint", type=Path, help="folder that a training run left")
    source.add_argument("--policy", choices=REFERENCES, help="a reference policy")
    parser.add_argument("--design", help="2-C, 2-L, 3-C or 3-D (default: the checkpoint's, or 2-L)")
    parser.add_argument(
        "--preset", help="arena: fast or paper (default: the checkpoint's, or fast)"
    )
    parser.add_argument("--condition", default="eval", help="train, eval, … (%(default)s)")
    parser.add_argument("--episodes", type=int, default=100, metavar="N", help="(%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the episodes (%(default)s)")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")


def run(options: argparse.Namespace) -> int:
    """Evaluate, print one row per program and the figures."""
    if options.episodes < 1:
        raise ConfigError(f"eval --episodes: expected at least 1, got {options.episodes}")
    if options.seed < 0:
        raise ConfigError(f"eval --seed: expected at least 0, got {options.seed}")
    facts: dict[str, str] = {}
    actor = None
    if options.checkpoint:
        path = trained(options.checkpoint)
        facts = read_metadata(path)["extra"]
        actor = Actor.of(load_policy(path))
    design = design_named(options.design or facts.get("design", "2-L"))
    arena = preset_named(options.preset or facts.get("preset", "fast"))
    policy = options.policy if actor is None else agent_policy(actor, arena)
    evaluation = evaluate(arena, design, policy, options.condition, options.episodes, options.seed)
    for row in by_program(evaluation):
        print(f"{row.program}: {row.episodes} episodes, {row.reward_per_step:+.3f} per step, "
              f"{row.success_rate:.0%} near at the end")  # fmt: skip
    write_report(
        options.json,
        {
            **figures(evaluation),
            "eval.design": design.name,
            "eval.preset": arena.preset,
            "eval.seed": options.seed,
            "device": device(),
            "threads": 1,
            "versions": versions(),
        },
    )
    return 0


def trained(out: Path) -> Path:
    """The checkpoint folder: the one given, or the one inside a training run's folder."""
    inner = out / "checkpoint"
    return inner if inner.is_dir() else out


def agent_policy(actor: Actor, arena: ArenaConfig) -> AgentPolicy:
    """The greedy actor as joint velocities for an arena."""
    speeds = np.array(arena.joint_speed_limits)

    def act(observation: Observation, program: str) -> Float64:
        return np.asarray(actor.act(observation, program).astype(np.float64) * speeds)

    return act


def figures(evaluation: Evaluation) -> Report:
    """The evaluation as a flat report; per-program rows are under `eval.program.<text>.…`."""
    raw, scaled = evaluation.raw, evaluation.normalized
    report: dict[str, float | int | str] = {
        "eval.reward_per_step": raw.mean,
        "eval.reward_per_step_low": raw.low,
        "eval.reward_per_step_high": raw.high,
        "eval.normalized": scaled.mean,
        "eval.normalized_low": scaled.low,
        "eval.normalized_high": scaled.high,
        "eval.success_rate": evaluation.success_rate,
        "eval.episodes": len(evaluation.scores),
        "eval.condition": evaluation.condition,
    }
    for row in by_program(evaluation):
        for name, value in asdict(row).items():
            if name != "program":
                report[f"eval.program.{row.program}.{name}"] = value
    return report
