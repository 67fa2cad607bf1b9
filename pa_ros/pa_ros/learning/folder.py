"""A run's folder: used by one run at a time, and never begun anew over another's work."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import IO

from pa_ros.core.files import take_lock
from pa_ros.learning.checkpoint_files import LATEST, completed, write_synced
from pa_ros.learning.errors import CheckpointError


def checkpoint_of(folder: Path) -> Path:
    """The folder of a run's checkpoints."""
    return folder / "checkpoint"


def holds_checkpoint(folder: Path) -> bool:
    """Whether a run's folder holds a checkpoint, damaged or not."""
    return (checkpoint_of(folder) / LATEST).exists() or bool(completed(checkpoint_of(folder)))


def refuse_used(folder: Path) -> None:
    """Raise CheckpointError if the folder holds a checkpoint."""
    if holds_checkpoint(folder):
        raise CheckpointError(
            f"{folder}: expected a folder without a run, got one that holds a checkpoint: resume "
            "it (--resume, or the learner's parameter resume), or name another folder",
            code="learning.folder_used",
        )


def _try_to_write(folder: Path) -> None:
    """Do what writing a checkpoint does, before a run of hours. Raises CheckpointError."""
    trial, renamed = folder / ".trial", folder / ".tried"
    try:
        shutil.rmtree(renamed, ignore_errors=True)  # of a run that was killed here
        trial.mkdir(exist_ok=True)
        write_synced(trial / "file", b"1")
        trial.replace(renamed)
        shutil.rmtree(renamed)
    except OSError as error:
        raise CheckpointError(f"{folder}: {error}") from error


def claim(folder: Path, resume: bool = False) -> IO[bytes]:
    """Lock a run's folder until the returned file is closed or the process ends.

    Raises CheckpointError if another run uses it (two would overwrite each other's checkpoints) or
    if it holds a checkpoint and `resume` is false; CheckpointError if it is not writable.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / ".lock").open("wb")
    except OSError as error:
        raise CheckpointError(f"{folder}: {error}") from error
    try:
        if not take_lock(lock.fileno()):
            raise CheckpointError(
                f"{folder}: expected a folder for this run alone, got one that another run writes "
                "into",
                code="learning.in_use",
            )
        if not resume:
            refuse_used(folder)
        _try_to_write(folder)
    except CheckpointError:
        lock.close()
        raise
    return lock
