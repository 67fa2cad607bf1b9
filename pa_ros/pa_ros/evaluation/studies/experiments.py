"""Experiments by name: several seeds of one setting, as a tidy table."""

from __future__ import annotations

import csv
import io
import logging
import math
import re
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pa_ros.arena import (
    ARMS,
    PRESETS,
    ReachTask,
    design_named,
    preset_named,
    scoring_of,
    training_programs,
    world_of,
)
from pa_ros.core.errors import ConfigError
from pa_ros.core.files import write_whole
from pa_ros.core.software import device, versions
from pa_ros.core.text import Report
from pa_ros.evaluation.scoring.agents import load_agent
from pa_ros.evaluation.scoring.benchmark import Benchmark, Scorer
from pa_ros.evaluation.scoring.rewards import normalized, rewards
from pa_ros.evaluation.scoring.tables import read_rows, write_rows, write_setting
from pa_ros.evaluation.scoring.training import TrainingScores
from pa_ros.evaluation.studies.curves import CURVE
from pa_ros.language import LOGICS, PRODUCT
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.checkpoint_files import make_latest, newest_whole
from pa_ros.learning.checkpoints import check_trained_with, read_metadata
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.folder import checkpoint_of, claim, holds_checkpoint
from pa_ros.learning.interfaces import Evaluate
from pa_ros.learning.loop import train
from pa_ros.learning.protocols import PROTOCOLS, LearningSettings

log = logging.getLogger(__name__)

SOLVED = 0.9  # held-out normalized score
FINAL_EPISODES = 100
DPG, OURS = "dpg", "ours"  # what is usual


@dataclass(frozen=True)
class Experiment:
    """One setting: everything but the seed."""

    name: str
    design: str
    frames: int
    network: str = "programmable"
    protocol: str = OURS
    preset: str = "fast"
    arm: str = "jaco"
    evaluate_every_frames: int = 2_500
    evaluation_episodes: int = 50
    options: Mapping[str, Any] = field(default_factory=dict)  # settings by dotted name
    tag: str = ""  # names what `options` changed
    switch_frames: int = 0  # train on the held-out programs from here on; 0: never
    algorithm: str = DPG

    @property
    def label(self) -> str:
        """Name of its tables, which says what is not usual of algorithm, protocol, preset and arm,
        and the tag."""
        parts = [self.name]
        if self.algorithm != DPG:
            parts.append(self.algorithm)
        if self.protocol != OURS:
            parts.append(f"{self.protocol}-protocol")
        if self.preset != "fast":
            parts.append(f"{self.preset}-arm")
        if self.arm != "jaco":
            parts.append(self.arm)
        return ".".join([*parts, *filter(None, [self.tag])])

    @property
    def settings(self) -> LearningSettings:
        """The protocol with this experiment's networks and options."""
        return LearningSettings(
            protocol=self.protocol,
            algorithm=self.algorithm,
            **{"network.family": self.network, **self.options},
        )

    @property
    def checkpoint_every_frames(self) -> int:
        """A quarter of it, and no more than is a pity to lose."""
        return min(50_000, max(self.frames // 4, 1))

    def __post_init__(self) -> None:
        _check_tag(self.tag)
        if self.frames < self.evaluate_every_frames:
            raise ConfigError(
                f"experiment frames: expected at least {self.evaluate_every_frames}, "
                f"one evaluation, got {self.frames}"
            )


def _check_tag(tag: str) -> None:
    """It becomes part of the names of files, beside words that say what isn't usual."""
    if tag and not re.fullmatch(r"[\w-]+(\.[\w-]+)*", tag, re.ASCII):
        raise ConfigError(
            f"experiment tag: expected letters, digits, '-' and '_', also with dots between, "
            f"got {tag!r}"
        )
    taken = {*ALGORITHMS, *ARMS, *LOGICS, *(f"{name}-arm" for name in PRESETS)}
    taken |= {f"{name}-protocol" for name in PROTOCOLS}
    for word in tag.split("."):
        if word in taken or word.endswith("-seeds"):
            raise ConfigError(
                f"experiment tag: expected another word than {word!r}, which names of tables "
                f"have already, got {tag!r}"
            )


EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (
        Experiment("programmable-2L", "2-L", 30_000),
        Experiment("programmable-3D", "3-D", 60_000),
        Experiment("programmable-3D-exact", "3-D-exact", 30_000),
        Experiment("distilled-2L", "2-L", 30_000, network="distilled-critic"),
        Experiment("distilled-3D", "3-D", 30_000, network="distilled-critic"),
        Experiment("canonical-2C", "2-C", 40_000, network="canonical"),
        Experiment("canonical-2L", "2-L", 40_000, network="canonical"),
        Experiment("canonical-3C", "3-C", 40_000, network="canonical"),
        Experiment(
            "forgetting",
            "3-D",
            200_000,
            options={
                "learner.relabeling.rule": "none",
                "learner.replay.capacity_frames": 50_000,
            },
            switch_frames=100_000,
        ),
    )
}
PAPER_FRAMES = {"2": 2_000_000, "3": 5_000_000}  # by the number of shapes and colors


def under_protocol(experiment: Experiment, protocol: str) -> Experiment:
    """The experiment under another protocol; under `paper`, for as many frames as there."""
    if protocol != "paper":
        return replace(experiment, protocol=protocol)
    frames = PAPER_FRAMES[experiment.design[0]]
    switch = frames // 2 if experiment.switch_frames else 0
    return replace(
        experiment,
        protocol=protocol,
        frames=frames,
        evaluate_every_frames=50_000,
        switch_frames=switch,
    )


def experiment_named(name: str) -> Experiment:
    """Look up an experiment; ConfigError names the known ones."""
    if name not in EXPERIMENTS:
        raise ConfigError(f"expected one of {', '.join(EXPERIMENTS)}, got {name!r}")
    return EXPERIMENTS[name]


def check_run(experiment: Experiment, seed: int, folder: Path, ended: bool = False) -> None:
    """Raise CheckpointError if a run in `folder` is of another setting or seed, or is longer.

    `ended`: also if it is shorter. Of a run without a whole checkpoint nothing is known.
    """
    try:
        newest, _ = newest_whole(checkpoint_of(folder))
    except CheckpointError:
        return
    arena = preset_named(experiment.preset, experiment.arm)
    design, settings = design_named(experiment.design), experiment.settings
    values = check_trained_with(
        newest,
        settings.network.for_world(world_of(arena, design)),
        settings.learner,
        scoring_of(arena, design),
        **{"seed": seed, "design": design.name, "preset": arena.preset, "arm": arena.arm},
    )
    reached, asked = int(values["counters"]["frames"]), experiment.frames
    if reached >= asked + arena.episode_steps or (ended and reached < asked):
        raise CheckpointError(f"checkpoint: {folder}: expected {asked} frames, got {reached}")


def run_seed(
    experiment: Experiment,
    seed: int,
    folder: Path,
    until: int | None = None,
    scores: Evaluate | None = None,
) -> Path:
    """Train one seed into `folder`, or go on where it was interrupted; its progress.csv.

    A seed that is saved with its frames, or `until`, is not run again. How it is parted changes
    nothing. `scores` is asked in place of `TrainingScores`.
    """
    frames = min(until or experiment.frames, experiment.frames)
    switch, saved = experiment.switch_frames, frames_saved(folder)
    if switch and saved < min(switch, frames):
        _train_until(experiment, seed, folder, min(switch, frames), "train", scores)
    if saved < frames:
        _train_until(experiment, seed, folder, frames, "eval" if switch else "train", scores)
    return folder / CURVE


def frames_saved(folder: Path, claimed: bool = False) -> int:
    """Frames of a run's newest whole checkpoint, which is made its latest; 0 if there is none.

    `claimed`: the caller has the folder for itself. Raises CheckpointError where all are damaged.
    """
    if not holds_checkpoint(folder):
        return 0
    newest, passed_over = newest_whole(checkpoint_of(folder))
    if passed_over:
        with nullcontext() if claimed else claim(folder, resume=True):
            log.warning(passed_over)
            make_latest(newest)
    return int(read_metadata(newest)["counters"]["frames"])


def _train_until(
    experiment: Experiment,
    seed: int,
    folder: Path,
    frames: int,
    condition: str,
    scores: Evaluate | None,
) -> None:
    arena = preset_named(experiment.preset, experiment.arm)
    design = design_named(experiment.design)
    settings = experiment.settings
    train(
        TrainConfig(
            out=folder,
            seed=seed,
            frames=frames,
            design=design.name,
            preset=arena.preset,
            arm=arena.arm,
            condition=condition,
            evaluate_every_frames=experiment.evaluate_every_frames,
            checkpoint_every_frames=experiment.checkpoint_every_frames,
        ),
        settings.network.for_world(world_of(arena, design)),
        settings.learner,
        ReachTask(arena, design, seed),
        np.array(arena.joint_speed_limits),
        training_programs(design),
        scores or TrainingScores(arena, design, experiment.evaluation_episodes),
        resume=holds_checkpoint(folder),
    )


@dataclass(frozen=True, slots=True)
class SeedSummary:
    """What became of one seed; frames and seconds are NaN if its score never came to stay."""

    seed: int
    frames: float  # reached
    frames_to_solve: float  # when the held-out score reached SOLVED to stay
    wall_s_to_solve: float
    held_out_at_end: float  # normalized, on the episodes of the curve
    train_at_end: float  # normalized
    final_held_out: float  # normalized, on episodes used for nothing else; NaN: not scored
    final_train: float

    @property
    def solved(self) -> bool:
        """Whether the held-out score is at least SOLVED at the end, on fresh episodes if scored."""
        final = self.final_held_out
        return (self.held_out_at_end if math.isnan(final) else final) >= SOLVED


def summarize(
    seed: int, rows: Sequence[dict[str, float]], final: tuple[float, float] = (math.nan, math.nan)
) -> SeedSummary:
    """`rows` of one curve, in order, and its final scores, held out and in training.

    Designs that hold nothing out are judged in training.
    """
    column = "eval_greedy.normalized"
    if column not in rows[-1]:
        column = "train_greedy.normalized"
    first: dict[str, float] | None = None
    for row in reversed(rows):
        if not row[column] >= SOLVED:  # nor where there is none
            break
        first = row
    return SeedSummary(
        seed,
        rows[-1]["frames"],
        first["frames"] if first else math.nan,
        first["wall_s"] if first else math.nan,
        rows[-1][column],
        rows[-1]["train_greedy.normalized"],
        *final,
    )


def final_scores(folder: Path, cache: Path, episodes: int = FINAL_EPISODES) -> tuple[float, float]:
    """Normalized scores, held out and in training, of a run's last checkpoint on fresh episodes,
    acting as it did while it learned: by PRODUCT."""
    agent = load_agent(folder, logic=PRODUCT)
    scorer = Scorer(Benchmark(design=agent.design, arena=agent.arena, episodes=episodes), cache)

    def score(condition: str) -> float:
        low, high, own = (
            float(rewards(scores).mean())
            for scores in (
                scorer.reference("random", condition),
                scorer.reference("scripted", condition),
                scorer.agent(agent, condition),
            )
        )
        return normalized(own, low, high)

    trained_on = score("train")
    return (score("eval") if agent.design.held_out else trained_on), trained_on


def write_table(
    folder: Path,
    experiment: Experiment,
    curves: dict[int, list[dict[str, float]]],
    summaries: Sequence[SeedSummary],
    made_on: Mapping[int, str] | None = None,
) -> Path:
    """All curves as one CSV with a `seed` column; beside it a row per seed, and the setting.

    `made_on`: on what software and machines a seed was trained, as far as its checkpoint says.
    """
    path = folder / f"{experiment.label}.csv"
    names = list(next(iter(curves.values()))[0])
    file = io.StringIO(newline="")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["seed", *names])
    for seed, rows in curves.items():
        for row in rows:
            if list(row) != names:
                raise CheckpointError(
                    f"curve: seed {seed}: expected columns {names} as the first, got {list(row)}"
                )
            writer.writerow([seed, *(f"{value:.6g}" for value in row.values())])
    write_whole(path, file.getvalue())
    write_rows(seeds_table(path), summaries)
    settings = experiment.settings
    design = design_named(experiment.design)
    setting = {
        **asdict(experiment),
        "learner": settings.learner.model_dump(mode="json"),
        "network_options": settings.network.model_dump(mode="json"),
        "words": design.vocabulary.by_group,
        "seeds": sorted(curves),
        "made_on": made_on or {},
        "device": device(),
        "versions": versions(),
    }
    write_setting(path, setting)
    return path


def seeds_table(curves: Path) -> Path:
    """The table of seeds that belongs to a table of curves."""
    return curves.with_name(f"{curves.stem}-seeds.csv")


def headline(folder: Path) -> Report:
    """Seeds solved and median frames to solve of the tables in `folder`, by design and arm.

    A seed that is not solved counts as infinitely many frames; a median of those is written "inf".
    """
    report: dict[str, float | int | str] = {}
    for name, design in (("programmable-2L", "2-L"), ("programmable-3D", "3-D")):
        for preset, suffix in (("fast", ""), ("paper", ".paper-arm")):
            usual = replace(EXPERIMENTS[name], preset=preset)
            label = usual.label
            path = seeds_table(folder / f"{label}.csv")
            if not path.exists():
                continue
            seeds = read_rows(path, SeedSummary)
            frames = [
                math.inf if math.isnan(seed.frames_to_solve) else seed.frames_to_solve
                for seed in seeds
            ]
            median = float(np.median(frames))
            report[f"frames_to_solve.{design}{suffix}.median"] = (
                median if math.isfinite(median) else "inf"
            )
            report[f"solved.{design}{suffix}"] = sum(seed.solved for seed in seeds)
            report[f"seeds.{design}{suffix}"] = len(seeds)
    return report
