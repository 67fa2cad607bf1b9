"""Training on a Ray cluster (the extra `cluster`).

A seed is trained in parts. This process keeps what every part starts from, so a lost node costs no
more than the part that it worked on. Files travel as bytes; nodes keep nothing.
"""

from __future__ import annotations

import importlib
import os
import socket
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from laboratory.studies.experiments import Experiment, frames_saved, run_seed
from laboratory.studies.seeds import SeedsProgress, check_failures, folder_of
from laboratory.studies.tables import CURVE, EvaluationError
from pa_ros.core import extensions
from pa_ros.core.errors import PaError
from pa_ros.core.files import written_beside
from pa_ros.core.software import versions
from pa_ros.learning.checkpoint_files import LATEST, find_checkpoint, remove_older
from pa_ros.learning.folder import checkpoint_of, claim, holds_checkpoint

Files = Mapping[str, bytes]
"""Contents by the path within a folder."""

CODE = "evaluation.cluster"
REFRESH_S = 1.0
ANSWER_S = 5.0  # for the head to accept a connection
LOSSES = 5  # of one part in a row; then the job is given up


@dataclass(frozen=True)
class Part:
    """Training for a node, in a folder that holds `files`."""

    train: Callable[[Path], object]  # a function of a module, so that nodes import it
    files: Files


class Cluster:
    """The Ray cluster whose head listens at `address` (HOST:PORT); a context manager.

    Raises EvaluationError unless Ray is installed and the head answers.
    """

    def __init__(self, address: str, extended: Sequence[str] = ()) -> None:
        """`extended`: extensions that nodes import."""
        self._extended = extended
        self._ray = _import_ray()
        _check_answers(address)
        try:
            self._ray.init(address, log_to_driver=False, logging_level="ERROR", namespace="pa_ros")
        except (ConnectionError, RuntimeError, ValueError, AssertionError) as error:
            self._ray.shutdown()
            reason = " ".join(str(error).split())
            raise EvaluationError(
                f"cluster {address}: expected Ray's head, got: {reason}", code=CODE
            ) from error

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        self._ray.shutdown()  # this also cancels what is still running

    def run(
        self, jobs: Iterable[SeedJob], progress: Callable[[], None], log: Callable[[str], None]
    ) -> None:
        """Do all jobs, as many at a time as the cluster has processors.

        `progress` is called about once a second; `log` reports lost parts, which are repeated, and
        failed jobs. If jobs fail, the others are still done; then EvaluationError is raised. It is
        raised at once if a node cannot be used or one part is lost LOSSES times.
        """
        # Ray must not retry by itself: a repeated part starts from newer files.
        task = self._ray.remote(num_cpus=1, max_retries=0)(do_part)
        software, lost = versions(), dict[str, int]()
        failures: dict[str, PaError] = {}
        running: dict[Any, SeedJob] = {}
        waiting = deque(jobs)
        while waiting or running:
            processors = int(self._ray.cluster_resources().get("CPU", 0))
            while waiting and len(running) < max(1, processors):
                job = waiting.popleft()
                if (part := job.part()) is not None:
                    running[task.remote(part, software, self._extended)] = job
            ended, _ = self._ray.wait(list(running), timeout=REFRESH_S) if running else ([], [])
            for reference in ended:
                job = running.pop(reference)
                try:
                    self._receive(reference, job)
                    lost.pop(job.name, None)
                except _LostNode as why:
                    lost[job.name] = lost.get(job.name, 0) + 1
                    if lost[job.name] >= LOSSES:
                        raise EvaluationError(
                            f"cluster: {job.name}: lost the same part {LOSSES} times ({why})",
                            code=CODE,
                        ) from None
                    log(f"{job.name}: its node was lost ({why}); the part is repeated")
                except PaError as error:
                    if error.code == CODE:
                        raise
                    failures[job.name] = error
                    log(f"{job.name} failed: {error}")
                    continue
                # A job that has begun goes first, so that jobs end one after the other.
                waiting.appendleft(job)
            progress()
        check_failures(failures)

    def _receive(self, reference: Any, job: SeedJob) -> None:
        """Store what a part returned. Raises _LostNode, or the error that the part raised."""
        errors = self._ray.exceptions
        try:
            job.receive(self._ray.get(reference))
        except errors.RayTaskError as error:
            if isinstance(error.cause, PaError):
                raise error.cause from None
            raise EvaluationError(f"cluster: {job.name}: {error}", code=CODE) from error
        except errors.RayError as error:
            raise _LostNode(type(error).__name__) from error


class _LostNode(Exception):
    """A part ended with its node."""


def do_part(part: Part, software: str, extended: Sequence[str]) -> dict[str, bytes]:
    """Do a part on a node, in a temporary folder. Raises EvaluationError for other software."""
    if versions() != software:
        raise EvaluationError(
            f"cluster: expected {software} on every node, got {versions()} on "
            f"{socket.gethostname()}",
            code=CODE,
        )
    extensions.load(extended)
    with tempfile.TemporaryDirectory(prefix="pa-ros-part-") as name:
        folder = Path(name)
        write_files(folder, part.files)
        part.train(folder)
        return dict(run_files(folder))


def read_files(root: Path, paths: Iterable[Path]) -> Files:
    """The contents of files below `root`."""
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in paths}


def write_files(root: Path, files: Files) -> None:
    """Write files below `root` in order, each whole or not at all."""
    for name, content in files.items():
        # This process may be killed at any moment, and a later one continues from these files.
        with written_beside(root / name) as beside:
            beside.write_bytes(content)


def _import_ray() -> Any:
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # Ray would send statistics to its makers
    try:
        return importlib.import_module("ray")
    except ImportError as error:
        raise EvaluationError(
            'cluster: expected the extra cluster (pip install "programmable-agents[cluster]"), '
            f"got: {error}",
            code=CODE,
        ) from error


def _check_answers(address: str) -> None:
    """Raise EvaluationError if nothing listens there; Ray itself would try for minutes."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host, int(port)), ANSWER_S).close()
    except (OSError, ValueError, OverflowError) as error:
        raise EvaluationError(
            f"cluster: expected HOST:PORT of Ray's head, got {address!r}: {error}", code=CODE
        ) from error


def train_seeds_on(
    cluster: Cluster, experiment: Experiment, seeds: Sequence[int], folder: Path
) -> None:
    """Train seeds like `seeds.train_seeds`, with each seed's parts on nodes of a cluster.

    Checkpoints are stored in the seed's folder here, as if it had been trained here, so that
    training can continue on the cluster or without it.
    """
    jobs = [SeedJob(experiment, seed, folder_of(folder, seed)) for seed in seeds]
    with ExitStack() as stack:
        for job in jobs:
            stack.enter_context(claim(job.folder, resume=True))
        progress = SeedsProgress(experiment, [job.folder for job in jobs])
        stack.enter_context(progress)
        cluster.run(jobs, progress.show, progress.log)


@dataclass(frozen=True)
class SeedJob:
    """A seed of an experiment, in parts from one checkpoint to the next."""

    experiment: Experiment
    seed: int
    folder: Path

    @property
    def name(self) -> str:
        """Its name in messages."""
        return f"seed {self.seed}"

    def part(self) -> Part | None:
        """The next part, from what has been received so far; None when all is done."""
        done, frames = frames_saved(self.folder), self.experiment.frames
        if done >= frames:
            return None
        every = self.experiment.checkpoint_every_frames
        until = min(frames, (done // every + 1) * every)
        train = partial(run_seed, self.experiment, self.seed, until=until)
        return Part(train, run_files(self.folder))

    def receive(self, files: Files) -> None:
        """Store the files of a finished part."""
        write_files(self.folder, files)
        root = checkpoint_of(self.folder)
        remove_older(root, find_checkpoint(root).name)


def run_files(folder: Path) -> Files:
    """The files that a run needs to continue: its newest checkpoint and its curve, LATEST last."""
    if not holds_checkpoint(folder):
        return {}
    root = checkpoint_of(folder)
    curve = [path for path in (folder / CURVE,) if path.exists()]
    return read_files(folder, [*sorted(find_checkpoint(root).iterdir()), *curve, root / LATEST])
