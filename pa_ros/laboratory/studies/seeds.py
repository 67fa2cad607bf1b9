"""The seeds of an experiment: trained in parallel processes, and put into tables."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from pathlib import Path

from pydantic import Field
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from laboratory.studies.experiments import (
    Experiment,
    SeedSummary,
    final_scores,
    run_seed,
    summarize,
    write_table,
)
from laboratory.studies.processes import end_with_parent
from laboratory.studies.tables import CURVE, EvaluationError, frames_done, read_curve
from pa_ros.core import extensions
from pa_ros.core.errors import PaError
from pa_ros.core.settings import Settings
from pa_ros.core.signals import interrupts_later
from pa_ros.learning.checkpoints import read_metadata
from pa_ros.learning.folder import checkpoint_of, holds_checkpoint
from pa_ros.learning.run import MADE_ON

REFRESH_S = 1.0


class SeedsConfig(Settings):
    """Which seeds of an experiment."""

    seeds: int = Field(3, ge=1, description="how many")
    first_seed: int = Field(0, ge=0, description="the first of them")
    jobs: int = Field(1, ge=1, description="seeds trained at a time")


def train_seeds(
    experiment: Experiment,
    seeds: Sequence[int],
    folder: Path,
    jobs: int,
    extended: Sequence[str] = (),
) -> None:
    """Train each seed in a process, `jobs` at a time, showing progress.

    `extended`: extensions that the processes import. If a seed fails, the others are still trained;
    then EvaluationError is raised.
    """
    folders = [folder_of(folder, seed) for seed in seeds]
    with _processes(jobs, extended) as pool, SeedsProgress(experiment, folders) as progress:
        with interrupts_later():  # Ctrl-C is for this process, which ends the others
            seed_of: dict[Future[Path], int] = {
                pool.submit(run_seed, experiment, seed, into): seed
                for seed, into in zip(seeds, folders, strict=True)
            }
        pending, failures = set(seed_of), dict[str, PaError]()
        while pending:
            ended, pending = wait(pending, REFRESH_S, FIRST_COMPLETED)
            for future in ended:
                name = f"seed {seed_of[future]}"
                try:
                    future.result()
                    progress.log(f"{name} is trained")
                except PaError as error:
                    failures[name] = error
                    progress.log(f"{name} failed: {error}")
                except BrokenProcessPool as error:
                    raise EvaluationError(
                        "a training process was killed, perhaps for lack of memory: run the same "
                        "command again to continue from each seed's last checkpoint",
                        code="evaluation.failed",
                    ) from error
            progress.show()
    check_failures(failures)


def check_failures(failures: Mapping[str, PaError]) -> None:
    """Raise EvaluationError if there are any, named by what failed."""
    if failures:
        what = "; ".join(f"{name}: {error}" for name, error in failures.items())
        raise EvaluationError(
            f"expected all to succeed, but failed: {what}; the others are done",
            code="evaluation.failed",
        )


def folder_of(folder: Path, seed: int) -> Path:
    """The folder in which a seed of an experiment is trained."""
    return folder / f"seed-{seed}"


class SeedsProgress:
    """A progress bar over all seeds; a context manager."""

    def __init__(self, experiment: Experiment, folders: Sequence[Path]) -> None:
        self._frames, self._curves = experiment.frames, [folder / CURVE for folder in folders]
        self._bar = progress_bar()
        self._bar.add_task(experiment.label, total=experiment.frames * len(folders))

    def __enter__(self) -> SeedsProgress:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def show(self) -> None:
        """Read the learning curves and redraw the bar."""
        reached = 0.0
        for curve in self._curves:
            with suppress(EvaluationError):  # its training reports a damaged curve
                reached += min(frames_done(curve), self._frames)
        self._bar.update(self._bar.task_ids[0], completed=reached)

    def log(self, line: str) -> None:
        """Print a line above the bar."""
        self._bar.console.print(line, markup=False, soft_wrap=True)


def progress_bar() -> Progress:
    """Share done and time left."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f}%"))
    return Progress(*columns, TimeRemainingColumn())


@contextmanager
def _processes(count: int, extended: Sequence[str]) -> Iterator[ProcessPoolExecutor]:
    """A pool that ends at once after an exception, also after Ctrl-C.

    Seeds can be ended like this because they continue from their last checkpoint.
    """
    # A forked process would share torch's threads and the parent's random state.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(count, context, _start_process, (extended,)) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                process.terminate()
            raise


def _start_process(extended: Sequence[str]) -> None:
    end_with_parent()
    extensions.load(extended)


def tabulate(
    experiment: Experiment, seeds: Sequence[int], folder: Path, results: Path, scores: Path
) -> tuple[Path, list[SeedSummary]] | None:
    """Write the tables of each seed that has a curve, finished or not; None if no seed has.

    Returns the table of curves and a summary of each seed. A seed with a checkpoint is scored on
    fresh episodes; `scores` keeps these scores.
    """
    curves: dict[int, list[dict[str, float]]] = {}
    summaries: list[SeedSummary] = []
    made_on: dict[int, str] = {}
    for seed in seeds:
        run = folder_of(folder, seed)
        if not frames_done(run / CURVE):
            continue
        rows = curves[seed] = read_curve(run / CURVE)
        if holds_checkpoint(run):
            final = final_scores(run, scores)
            summaries.append(summarize(seed, rows, final, experiment.score))
            made_on[seed] = str(read_metadata(checkpoint_of(run))["extra"].get(MADE_ON, ""))
        else:
            summaries.append(summarize(seed, rows, score=experiment.score))
    if not curves:
        return None
    return write_table(results, experiment, curves, summaries, made_on), summaries
