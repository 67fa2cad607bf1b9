"""Experiments by name: several seeds of one setting, as a tidy table."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.core.errors import ConfigError
from pa_ros.core.report import device, versions
from pa_ros.evaluation.training import TrainingScores, training_programs
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.loop import TrainConfig, train
from pa_ros.learning.protocols import protocol_named

SOLVED = 0.9  # held-out normalized score


@dataclass(frozen=True)
class Experiment:
    """One setting: everything but the seed."""

    name: str
    design: str
    frames: int
    network: str = "programmable"
    protocol: str = "ours"
    preset: str = "fast"
    evaluate_every_frames: int = 5_000
    evaluation_episodes: int = 50

    def __post_init__(self) -> None:
        if self.frames < self.evaluate_every_frames:
            raise ConfigError(
                f"experiment frames: expected at least {self.evaluate_every_frames}, "
                f"one evaluation, got {self.frames}"
            )


EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (
        Experiment("programmable-2L", "2-L", 100_000),
        Experiment("programmable-3D", "3-D", 200_000),
        Experiment("distilled-2L", "2-L", 100_000, network="distilled-critic"),
        Experiment("distilled-3D", "3-D", 200_000, network="distilled-critic"),
        Experiment("canonical-2C", "2-C", 100_000, network="canonical"),
        Experiment("canonical-2L", "2-L", 100_000, network="canonical"),
    )
}


def experiment_named(name: str) -> Experiment:
    """Look up an experiment; ConfigError names the known ones."""
    if name not in EXPERIMENTS:
        raise ConfigError(f"expected an experiment of {sorted(EXPERIMENTS)}, got {name!r}")
    return EXPERIMENTS[name]


def run_seed(experiment: Experiment, seed: int, folder: Path) -> Path:
    """Train one seed into `folder`, or go on where it was interrupted; its progress.csv.

    A seed that reached its frames is not run again.
    """
    arena, design = preset_named(experiment.preset), design_named(experiment.design)
    protocol = protocol_named(experiment.protocol)
    curve = folder / "progress.csv"
    if _frames_done(curve) >= experiment.frames:
        return curve
    train(
        TrainConfig(
            out=folder,
            seed=seed,
            frames=experiment.frames,
            design=design.name,
            preset=arena.preset,
            evaluate_every_frames=experiment.evaluate_every_frames,
            checkpoint_every_frames=max(experiment.frames // 4, 1),
        ),
        protocol.network_config(design.vocabulary, experiment.network),
        replace(protocol.learner, near_threshold=arena.near_threshold_m),
        ReachTask(arena, design, seed),
        np.array(arena.joint_speed_limits),
        training_programs(design),
        TrainingScores(arena, design, experiment.evaluation_episodes),
        resume=(folder / "checkpoint" / "LATEST").exists(),
    )
    return curve


def read_curve(path: Path) -> list[dict[str, float]]:
    """Rows of a progress.csv; CheckpointError if it cannot be read as one."""
    try:
        with path.open(newline="") as file:
            return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    except (OSError, ValueError, TypeError) as error:
        raise CheckpointError(f"curve: {path}: {error!r}") from error


def _frames_done(path: Path) -> float:
    rows = read_curve(path) if path.exists() else []
    return rows[-1]["frames"] if rows else 0.0


@dataclass(frozen=True, slots=True)
class SeedSummary:
    """When one seed's held-out score reached SOLVED to stay; NaN if it did not."""

    seed: int
    frames_to_solve: float
    wall_s_to_solve: float
    held_out_at_end: float  # normalized
    train_at_end: float  # normalized

    @property
    def solved(self) -> bool:
        """Whether the held-out score is at least SOLVED at the end."""
        return self.held_out_at_end >= SOLVED


def summarize(seed: int, rows: Sequence[dict[str, float]]) -> SeedSummary:
    """`rows` of one curve, in order; designs that hold nothing out are judged in training."""
    column = "eval_greedy.normalized"
    if column not in rows[-1]:
        column = "train_greedy.normalized"
    first: dict[str, float] | None = None
    for row in reversed(rows):
        if row[column] < SOLVED:
            break
        first = row
    nan = float("nan")
    return SeedSummary(
        seed,
        first["frames"] if first else nan,
        first["wall_s"] if first else nan,
        rows[-1][column],
        rows[-1]["train_greedy.normalized"],
    )


def write_table(
    path: Path, experiment: Experiment, curves: dict[int, list[dict[str, float]]]
) -> None:
    """All curves as one CSV with a `seed` column, and the setting as JSON beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        names = ["seed", *next(iter(curves.values()))[0]]
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        for seed, rows in curves.items():
            for row in rows:
                cells = {name: f"{value:.6g}" for name, value in row.items()}
                writer.writerow({"seed": seed, **cells})
    protocol = protocol_named(experiment.protocol)
    setting = {
        **asdict(experiment),
        "learner": asdict(protocol.learner),
        "network_options": dict(protocol.network),
        "seeds": sorted(curves),
        "device": device(),
        "versions": versions(),
    }
    path.with_suffix(".json").write_text(json.dumps(setting, indent=1) + "\n")
