"""What a demonstration found, and how it says so: table, demo.json, closing words."""

from __future__ import annotations

import json
from dataclasses import dataclass, field

import numpy as np

from pa_ros.acting.execution import Execution
from pa_ros.core.files import write_whole
from pa_ros.core.software import device, versions
from pa_ros.evaluation.scoring.tally import EpisodeTally, HeldOutTarget
from pa_ros.tools.demo.config import DemoConfig
from pa_ros.tools.demo.scenes import DemoProgram, Scene

NEEDED = 5  # programs of the six, the held-out one among them


@dataclass
class Outcome:
    """What a demonstration found; becomes demo.json."""

    tally: EpisodeTally = field(default_factory=EpisodeTally)
    train_wall_s: float = 0.0
    reached: bool = False
    executions: list[tuple[DemoProgram, Scene, Execution]] = field(default_factory=list)

    @property
    def satisfied(self) -> int:
        """How many of the programs were executed."""
        return sum(execution.satisfied for _, _, execution in self.executions)

    @property
    def executed(self) -> bool:
        """The held-out program and at least NEEDED of the six were satisfied."""
        held_out = any(e.satisfied for p, _, e in self.executions if p.kind == "held out")
        return held_out and self.satisfied >= NEEDED

    @property
    def success(self) -> bool:
        """The target was reached, and the programs were executed."""
        return self.reached and self.executed


def execution_row(program: DemoProgram, scene: Scene, execution: Execution) -> str:
    """One program's line of the table."""
    after = "" if execution.reached_s is None else f"{execution.reached_s:.1f} s"
    satisfied = "yes" if execution.satisfied else "NO"
    distances = f"{scene.distance:.2f} m", f"{execution.distance:.2f} m"
    return row(program.kind, program.text, *distances, satisfied, after)


def row(*cells: str) -> str:
    """Six cells of the table of programs."""
    widths = (12, 56, 7, 7, 10, 13)
    return " ".join(f"{cell:<{width}}" for cell, width in zip(cells, widths, strict=True)).rstrip()


def write_report(
    config: DemoConfig, target: HeldOutTarget, outcome: Outcome, shipped: Outcome
) -> None:
    """demo.json: flat, dotted names; what was not measured is left out."""
    score, success = target.score(outcome.tally)
    report: dict[str, float | int | str] = {
        "demo.design": config.design.name,
        "demo.preset": config.arena.preset,
        "demo.seed": config.seed,
        "demo.reached": int(outcome.reached),
        "demo.train_wall_s": outcome.train_wall_s,
        "demo.frames": outcome.tally.frames,
        "demo.held_out_normalized": score,
        "demo.held_out_success_rate": success,
        "demo.random_reward_per_step": target.random,
        "demo.scripted_reward_per_step": target.scripted,
        "demo.success": int(outcome.success),
    }
    report |= _executions("demo", outcome) | _executions("shipped", shipped)
    report |= {"device": device(), "threads": 1, "versions": versions()}
    finite = {k: v for k, v in report.items() if not isinstance(v, float) or np.isfinite(v)}
    write_whole(config.folder / "demo.json", json.dumps(finite, indent=2) + "\n")


def _executions(prefix: str, outcome: Outcome) -> dict[str, float | int | str]:
    report: dict[str, float | int | str] = {
        f"{prefix}.programs": len(outcome.executions),
        f"{prefix}.satisfied": outcome.satisfied,
    }
    for program, scene, execution in outcome.executions:
        name = f"{prefix}.{program.kind.lower().replace(' ', '_')}"
        report |= {
            f"{name}.program": program.text,
            f"{name}.satisfied": int(execution.satisfied),
            f"{name}.distance_from_m": scene.distance,
            f"{name}.distance_to_m": execution.distance,
        }
        if execution.reached_s is not None:
            report[f"{name}.reached_s"] = execution.reached_s
    return report


def conclude(config: DemoConfig, target: HeldOutTarget, outcome: Outcome) -> None:
    """The closing words: how many programs were executed, and what is left where."""
    if outcome.executions:
        print(f"\n{outcome.satisfied} of {len(outcome.executions)} programs executed.")
    else:
        score, success = target.score(outcome.tally)
        print(
            f"No success within {config.minutes:g} minutes: zero-shot score {score:.2f} of "
            f"{target.normalized}, success {success:.0%} of {target.success:.0%}."
        )
    print(f"Left in {config.folder}/:")
    for name, what in (
        ("checkpoint/", "what was learned"),
        ("learning-curve.png", "reward per step, trained and zero-shot"),
        ("phi.png", "what the learned detectors see in one scene"),
        ("programs/", "the execution as an MCAP bag"),
        ("shipped/", "the same for the shipped agent"),
        ("demo.json", "these figures"),
        ("log/", "what each process wrote, and its parameters"),
    ):
        if (config.folder / name).exists():
            print(f"  {name:<20} {what}")
