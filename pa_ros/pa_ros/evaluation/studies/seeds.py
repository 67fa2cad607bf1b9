"""The seeds of an experiment: trained in processes of their own, and put into tables."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from pa_ros.core.settings import Settings
from pa_ros.evaluation.studies.experiments import (
    Experiment,
    SeedSummary,
    final_scores,
    frames_done,
    read_curve,
    run_seed,
    summarize,
    write_table,
)
from pa_ros.learning.folder import holds_checkpoint

REFRESH_S = 1.0


class SeedsConfig(Settings):
    """Which seeds of an experiment."""

    seeds: int = Field(3, ge=1, description="how many")
    first_seed: int = Field(0, ge=0, description="and the following")
    jobs: int = Field(1, ge=1, description="seeds at a time")


def train_seeds(experiment: Experiment, seeds: Sequence[int], folder: Path, jobs: int) -> None:
    """Each seed in a process, `jobs` at a time, with progress and time left."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f}%"))
    context = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(jobs, context) as pool,
        Progress(*columns, TimeRemainingColumn()) as progress,
    ):
        curves = {seed: folder / f"seed-{seed}" / "progress.csv" for seed in seeds}
        task = progress.add_task(experiment.label, total=experiment.frames * len(seeds))
        pending: set[Future[Path]] = {
            pool.submit(run_seed, experiment, seed, curve.parent) for seed, curve in curves.items()
        }
        while pending:
            ended, pending = wait(pending, REFRESH_S, FIRST_COMPLETED)
            for future in ended:
                future.result()
            reached = sum(min(frames_done(curve), experiment.frames) for curve in curves.values())
            progress.update(task, completed=reached)


@dataclass(frozen=True)
class Tabulated:
    """A table of learning curves, and a line for each of its seeds."""

    table: Path
    summaries: Sequence[SeedSummary]


def tabulate(
    experiment: Experiment, seeds: Sequence[int], folder: Path, results: Path, scores: Path
) -> Tabulated | None:
    """Tables of each seed that has a curve, however far it came; None if none has.

    `scores` keeps those of fresh episodes, from which a seed with a checkpoint is judged.
    """
    runs = {seed: folder / f"seed-{seed}" for seed in seeds}
    done = {seed: run for seed, run in runs.items() if frames_done(run / "progress.csv")}
    if not done:
        return None
    curves = {seed: read_curve(run / "progress.csv") for seed, run in done.items()}
    scored = {seed: holds_checkpoint(run) for seed, run in done.items()}
    summaries = [
        summarize(seed, rows, final_scores(done[seed], scores))
        if scored[seed]
        else summarize(seed, rows)
        for seed, rows in curves.items()
    ]
    return Tabulated(write_table(results, experiment, curves, summaries), summaries)
