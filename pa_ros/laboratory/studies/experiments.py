"""Experiments by name: training one seed of a setting, and the tables of its seeds."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from laboratory.studies.scorer import Benchmark, Scorer
from laboratory.studies.tables import CURVE, write_cells, write_rows, write_setting
from pa_ros.agents import camera_of, load_agent, train_agent
from pa_ros.arena import ArenaConfig, Design, design_named, preset_for, scoring_of
from pa_ros.arena.skills import NORMALIZED, SUCCESS
from pa_ros.core.errors import ConfigError
from pa_ros.core.software import device, versions
from pa_ros.language import PRODUCT
from pa_ros.learning.checkpoint_files import make_latest, newest_whole
from pa_ros.learning.checkpoints import check_trained_with, read_metadata
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.folder import checkpoint_of, holds_checkpoint
from pa_ros.learning.interfaces import Evaluate
from pa_ros.learning.recipes import DPG, LearningSettings, recipe_for
from pa_ros.perception import TOLD, VIEWS, task_seen
from pa_ros.world.relation import SIDES

log = logging.getLogger(__name__)

SOLVED = 0.9  # held-out score
FINAL_EPISODES = 100


@dataclass(frozen=True)
class Experiment:
    """A setting: everything but the seed."""

    name: str
    design: str
    frames: int
    network: str = "programmable"
    recipe: str = ""  # empty: the usual one of the design
    preset: str = ""  # of the arena; empty: the design's own
    arm: str = ""  # empty: the preset's own
    evaluate_every_frames: int = 2_500
    evaluation_episodes: int = 50
    options: Mapping[str, Any] = field(default_factory=dict)  # settings by dotted name
    tag: str = ""  # names what `options` changed
    switch_frames: int = 0  # train on the held-out programs from here on; 0: never
    algorithm: str = DPG
    relations: tuple[str, ...] = ()  # of the programs; empty: the design's own
    perception: str = TOLD  # or one of `perception.VIEWS`

    @property
    def label(self) -> str:
        """Name of its tables: what differs from the design's defaults (algorithm, recipe, preset,
        arm), and the tag."""
        parts, design = [self.name], self.task
        if self.algorithm != DPG:
            parts.append(self.algorithm)
        if self.recipe not in ("", recipe_for(design.vocabulary)):
            parts.append(f"{self.recipe}-recipe")
        if self.preset not in ("", design.preset):
            parts.append(f"{self.preset}-arm")
        if self.arena.arm != preset_for(design, self.preset).arm:
            parts.append(self.arm)
        return ".".join([*parts, *filter(None, [self.tag])])

    @property
    def task(self) -> Design:
        """The design, with the experiment's relations."""
        design = design_named(self.design)
        return design.with_relations(*self.relations) if self.relations else design

    @property
    def arena(self) -> ArenaConfig:
        """The arena in which it is trained."""
        return preset_for(self.task, self.preset, self.arm)

    @property
    def score(self) -> str:
        """The measure by which it is judged: NORMALIZED or SUCCESS."""
        return self.task.skill.score

    @property
    def settings(self) -> LearningSettings:
        """The recipe with this experiment's networks and options."""
        return LearningSettings(
            recipe=self.recipe or recipe_for(self.task.vocabulary),
            algorithm=self.algorithm,
            **{"network.family": self.network, **self.options},
        )

    @property
    def checkpoint_every_frames(self) -> int:
        """A quarter of the frames, and no more than one would mind losing."""
        return min(50_000, max(self.frames // 4, 1))

    def __post_init__(self) -> None:
        if self.tag and not re.fullmatch(r"[\w-]+(\.[\w-]+)*", self.tag):
            raise ConfigError(
                "experiment tag: expected letters, digits, '-' and '_', also with dots between, "
                f"got {self.tag!r}"
            )
        if self.frames < self.evaluate_every_frames:
            raise ConfigError(
                f"experiment frames: expected at least {self.evaluate_every_frames}, "
                f"one evaluation, got {self.frames}"
            )


def _moving(
    design: str, name: str = "", relations: tuple[str, ...] = (), frames: int = 150_000
) -> Experiment:
    """An experiment in which objects are moved."""
    return Experiment(
        name or design, design, frames, evaluate_every_frames=10_000, relations=relations
    )


def _seeing(view: str, design: str) -> Experiment:
    """An experiment in which objects are seen by a camera."""
    return Experiment(f"{view}-{design.replace('-', '')}", design, 25_000, perception=view,
                      evaluate_every_frames=5_000)  # fmt: skip


EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (
        Experiment("programmable-2L", "2-L", 30_000),
        Experiment("programmable-3D", "3-D", 60_000),
        _seeing("camera", "2-L"),
        *(_seeing(view, "3-D") for view in VIEWS),
        Experiment("programmable-3D-exact", "3-D-exact", 30_000),
        Experiment("relations-3D", "3-D-relations", 100_000),
        Experiment("above-red-3D", "3-D-above-red", 60_000),
        Experiment("avoid-3D", "3-D-avoid", 100_000),
        Experiment("sizes", "sizes", 40_000),
        Experiment("distilled-2L", "2-L", 30_000, network="distilled-critic"),
        Experiment("distilled-3D", "3-D", 30_000, network="distilled-critic"),
        Experiment("canonical-2C", "2-C", 40_000, network="canonical"),
        Experiment("canonical-2L", "2-L", 40_000, network="canonical"),
        Experiment("canonical-3C", "3-C", 40_000, network="canonical"),
        Experiment(
            "forgetting",
            "3-D",
            200_000,
            options={"learner.relabeling.rule": "none", "learner.replay.capacity_frames": 50_000},
            switch_frames=100_000,
        ),
        _moving("push-2"),
        _moving("push-3D"),
        _moving("push-2-pairs"),
        _moving("push-2", "push-2-sides", relations=("NEAR", *SIDES)),
        _moving("stack-2", frames=100_000),
        _moving("stack-3D", frames=150_000),
        *(
            Experiment(name, name, 100_000, evaluate_every_frames=10_000)
            for name in ("zones-8", "zones-16")
        ),
    )
}
ABLATIONS: Mapping[str, Mapping[str, Any]] = {
    "no-hindsight": {"learner.hindsight.future": 0.0},
    "no-moved": {"learner.hindsight.moved": 0.0},
    "no-cross": {"learner.hindsight.cross": 0.0},
    "no-either": {"learner.hindsight.either": 0.0},
    "no-held": {"learner.exploration.held": 0.0},
    "no-upper": {"network.upper_layers": 0},
    "no-halving": {"learner.optimizer.half_life": 0.0},
    "no-averaging": {"learner.updates.published": 1.0},
    "detector-gain-1": {"learner.detectors.gain": 1.0},
}
"""Tags of experiments that move objects, and what each of them changes."""
PAPER_FRAMES = {"2": 2_000_000, "3": 5_000_000}  # by the number of shapes and colors


def under_recipe(experiment: Experiment, recipe: str) -> Experiment:
    """The experiment under another recipe; under `paper`, for as many frames as the paper."""
    if recipe != "paper" or experiment.design[0] not in PAPER_FRAMES:
        return replace(experiment, recipe=recipe)
    frames = PAPER_FRAMES[experiment.design[0]]
    switch = frames // 2 if experiment.switch_frames else 0
    return replace(
        experiment, recipe=recipe, frames=frames, evaluate_every_frames=50_000, switch_frames=switch
    )


def check_run(experiment: Experiment, seed: int, folder: Path, ended: bool = False) -> None:
    """Raise CheckpointError if a run in `folder` has another setting or seed, or is longer.

    `ended`: also if it is shorter. A run without an undamaged checkpoint passes.
    """
    try:
        newest, _ = newest_whole(checkpoint_of(folder))
    except CheckpointError:
        return
    arena, design, settings = experiment.arena, experiment.task, experiment.settings
    kept = str(read_metadata(newest)["extra"].get("perception", ""))
    world = task_seen(arena, design, seed, kept).world
    values = check_trained_with(
        newest,
        settings.network.for_world(world),
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
    """Train one seed into `folder`, or continue where it was interrupted; returns its curve.

    A finished seed is not trained again. `until`: stop after so many frames; training in parts
    gives the same result. `scores` replaces `TrainingScores`.
    """
    frames = min(until or experiment.frames, experiment.frames)
    switch, saved = experiment.switch_frames, frames_saved(folder)
    if switch and saved < min(switch, frames):
        _train_until(experiment, seed, folder, min(switch, frames), "train", scores)
    if saved < frames:
        _train_until(experiment, seed, folder, frames, "eval" if switch else "train", scores)
    return folder / CURVE


def frames_saved(folder: Path) -> int:
    """Frames of a run's newest undamaged checkpoint, which becomes its latest; 0 without any.

    Raises CheckpointError if all are damaged.
    """
    if not holds_checkpoint(folder):
        return 0
    newest, passed_over = newest_whole(checkpoint_of(folder))
    if passed_over:
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
    arena, resume = experiment.arena, holds_checkpoint(folder)
    seen = folder if resume else None, arena, experiment.task, experiment.perception
    train_agent(
        arena,
        experiment.task,
        experiment.settings,
        TrainConfig(
            out=folder,
            seed=seed,
            frames=frames,
            condition=condition,
            evaluate_every_frames=experiment.evaluate_every_frames,
            evaluation_episodes=experiment.evaluation_episodes,
            checkpoint_every_frames=experiment.checkpoint_every_frames,
        ),
        scores=scores,
        perception=camera_of(*seen),
        resume=resume,
    )


@dataclass(frozen=True, slots=True)
class SeedSummary:
    """The result of one seed; frames and seconds to solve are NaN if it was not solved.

    Scores are NORMALIZED, or SUCCESS where the experiment is judged by that.
    """

    seed: int
    frames: float  # reached
    frames_to_solve: float  # from here on the held-out score stayed at SOLVED or above
    wall_s_to_solve: float
    held_out_at_end: float  # on the episodes of the curve
    train_at_end: float
    final_held_out: float  # on episodes used for nothing else; NaN: not scored
    final_train: float

    @property
    def solved(self) -> bool:
        """Whether the held-out score is at least SOLVED at the end, on fresh episodes if scored."""
        final = self.final_held_out
        return (self.held_out_at_end if math.isnan(final) else final) >= SOLVED


def summarize(
    seed: int,
    rows: Sequence[dict[str, float]],
    final: tuple[float, float] = (math.nan, math.nan),
    score: str = NORMALIZED,
) -> SeedSummary:
    """Summarize a curve's `rows`, in order, and its final scores, held out and in training.

    Designs that hold nothing out are judged by the score in training.
    """
    trained = f"train_greedy.{score}"
    column = f"eval_greedy.{score}"
    if column not in rows[-1]:
        column = trained
    # From the end backwards: a score that falls below the bound later was not solved before.
    first: dict[str, float] | None = None
    for row in reversed(rows):
        if not row[column] >= SOLVED:  # also for NaN
            break
        first = row
    return SeedSummary(
        seed,
        rows[-1]["frames"],
        first["frames"] if first else math.nan,
        first["wall_s"] if first else math.nan,
        rows[-1][column],
        rows[-1][trained],
        *final,
    )


def final_scores(folder: Path, cache: Path, episodes: int = FINAL_EPISODES) -> tuple[float, float]:
    """Scores of a run's last checkpoint on fresh episodes, held out and in training.

    The agent acts by PRODUCT, as it did while it learned. Where it is judged by success, scores are
    the shares of episodes that succeed, and it acts by the default logic, as in tables of
    conditions.
    """
    agent = load_agent(folder)
    by_success = agent.design.skill.score == SUCCESS
    agent = agent if by_success else replace(agent, logic=PRODUCT)
    scorer = Scorer(Benchmark(agent.design, agent.arena, episodes), cache)

    def score(condition: str) -> float:
        own = scorer.agent(agent, condition)
        if by_success:
            return float(np.mean([one.success for one in own]))
        return scorer.normalized(condition, own)

    trained_on = score("train")
    return (score("eval") if agent.design.held_out else trained_on), trained_on


def write_table(
    folder: Path,
    experiment: Experiment,
    curves: dict[int, list[dict[str, float]]],
    summaries: Sequence[SeedSummary],
    made_on: Mapping[int, str] | None = None,
) -> Path:
    """Write all curves as one CSV with a `seed` column, a table with a row per seed, the setting.

    `made_on`: software and machine of each seed, as far as its checkpoint says.
    """
    path = folder / f"{experiment.label}.csv"
    names = list(next(iter(curves.values()))[0])
    cells = [
        [seed, *(row[name] for name in names)] for seed, rows in curves.items() for row in rows
    ]
    write_cells(path, ["seed", *names], cells)
    write_rows(seeds_table(path), summaries)
    settings = experiment.settings
    setting = {
        **asdict(experiment),
        "recipe": settings.recipe,
        "preset": experiment.arena.preset,
        "arm": experiment.arena.arm,
        "score": experiment.score,
        "learner": settings.learner.model_dump(mode="json"),
        "network_options": settings.network.model_dump(mode="json"),
        "words": experiment.task.vocabulary.by_group,
        "seeds": sorted(curves),
        "made_on": made_on or {},
        "device": device(),
        "versions": versions(),
    }
    write_setting(path, setting)
    return path


def seeds_table(curves: Path) -> Path:
    """The path of the table of seeds that belongs to a table of curves."""
    return curves.with_name(f"{curves.stem}-seeds.csv")
