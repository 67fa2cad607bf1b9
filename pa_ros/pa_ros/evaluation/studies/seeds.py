"""The seeds of an experiment: trained in processes of their own, and put into tables."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from pa_ros.core import extensions
from pa_ros.core.errors import PaError
from pa_ros.core.settings import Settings
from pa_ros.core.signals import end_with_parent, interrupts_later
from pa_ros.core.text import renewable
from pa_ros.evaluation.studies.curves import CURVE, frames_done, read_curve
from pa_ros.evaluation.studies.experiments import (
    Experiment,
    SeedSummary,
    final_scores,
    run_seed,
    summarize,
    write_table,
)
from pa_ros.evaluation.studies.failures import FailedError, check_failures
from pa_ros.learning.checkpoints import read_metadata
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.folder import checkpoint_of, holds_checkpoint
from pa_ros.learning.run import MADE_ON

REFRESH_S = 1.0


class SeedsConfig(Settings):
    """Which seeds of an experiment."""

    seeds: int = Field(3, ge=1, description="how many")
    first_seed: int = Field(0, ge=0, description="and the following")
    jobs: int = Field(1, ge=1, description="seeds at a time")


def train_seeds(
    experiment: Experiment,
    seeds: Sequence[int],
    folder: Path,
    jobs: int,
    extended: Sequence[str] = (),
) -> None:
    """Each seed in a process, `jobs` at a time, with progress and time left.

    `extended`: extensions that the processes import. One that is refused or diverges is said and
    the others go on; FailedError, once they are through.
    """
    folders = [folder_of(folder, seed) for seed in seeds]
    with (
        _processes(jobs, extended) as pool,
        SeedsProgress(experiment, folders) as progress,
    ):
        with interrupts_later():  # Ctrl-C is for this process, which ends the others
            seed_of: dict[Future[Path], int] = {
                pool.submit(run_seed, experiment, seed, into): seed
                for seed, into in zip(seeds, folders, strict=True)
            }
        pending, failures = set(seed_of), dict[str, PaError]()
        while pending:
            ended, pending = wait(pending, REFRESH_S, FIRST_COMPLETED)
            for future in ended:
                try:
                    future.result()
                    progress.tell_unless_seen(f"seed {seed_of[future]} is trained")
                except PaError as error:
                    failures[f"seed {seed_of[future]}"] = error
                    progress.tell(f"seed {seed_of[future]} ended early: {error}")
                except BrokenProcessPool as error:
                    raise FailedError(
                        "a process was ended from outside, for want of memory perhaps: the same "
                        "command goes on from each seed's last checkpoint"
                    ) from error
            progress.show()
    check_failures(failures)


def folder_of(folder: Path, seed: int) -> Path:
    """Where a seed of an experiment is trained."""
    return folder / f"seed-{seed}"


class SeedsProgress:
    """A bar of how far all seeds are; a context."""

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
        """Read the curves, as far as they can be read, and draw."""
        reached = 0.0
        for curve in self._curves:
            with suppress(CheckpointError):  # which the seed itself is refused for
                reached += min(frames_done(curve), self._frames)
        self._bar.update(self._bar.task_ids[0], completed=reached)

    def tell(self, line: str) -> None:
        """Print a line above the bar."""
        self._bar.console.print(line, markup=False, soft_wrap=True)

    def tell_unless_seen(self, line: str) -> None:
        """The same where the bar is shown at the end alone: in a file, a dumb terminal."""
        if not renewable(self._bar.console):
            self.tell(line)


def progress_bar() -> Progress:
    """Share done and time left."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f}%"))
    return Progress(*columns, TimeRemainingColumn())


@contextmanager
def _processes(count: int, extended: Sequence[str]) -> Iterator[ProcessPoolExecutor]:
    """A pool that an exception, Ctrl-C's too, ends at once, with what it has yet to do: a seed goes
    on from its last checkpoint."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(count, context, _begin, (extended,)) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                process.terminate()
            raise


def _begin(extended: Sequence[str]) -> None:
    end_with_parent()
    extensions.load(extended)


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
    runs = {seed: folder_of(folder, seed) for seed in seeds}
    done = {seed: run for seed, run in runs.items() if frames_done(run / CURVE)}
    if not done:
        return None
    curves = {seed: read_curve(run / CURVE) for seed, run in done.items()}
    scored = {seed: holds_checkpoint(run) for seed, run in done.items()}
    summaries = [
        summarize(seed, rows, final_scores(done[seed], scores))
        if scored[seed]
        else summarize(seed, rows)
        for seed, rows in curves.items()
    ]
    made_on = {seed: _made_on(run) for seed, run in done.items() if scored[seed]}
    return Tabulated(write_table(results, experiment, curves, summaries, made_on), summaries)


def _made_on(run: Path) -> str:
    """Software and machines of a seed; empty: of 0.2, which didn't say."""
    return str(read_metadata(checkpoint_of(run))["extra"].get(MADE_ON, ""))
