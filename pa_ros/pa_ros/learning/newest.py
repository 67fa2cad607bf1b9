"""Which checkpoint a run goes on from: the newest whose files are as they were written."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from pa_ros.learning.checkpoints import LATEST, completed, find_checkpoint
from pa_ros.learning.checksums import check_files
from pa_ros.learning.errors import CheckpointError


def newest_whole(root: Path) -> tuple[Path, str]:
    """The newest whole checkpoint under a root; and why newer ones are passed over, or "".

    Raises CheckpointError, naming each damage, if none is whole.
    """
    latest, damages = _latest(root), list[str]()
    for directory in _candidates(root):
        try:
            check_files(directory)
            find_checkpoint(directory)
        except CheckpointError as error:
            damages.append(str(error))
            continue
        if latest is None:
            damages = [f"checkpoint: {root / LATEST}: names no checkpoint", *damages]
        passed_over = "; ".join(damages)
        return directory, passed_over and f"{passed_over}; the run goes on from {directory.name}"
    raise CheckpointError("; ".join(damages) or f"checkpoint: expected one at {root}, found none")


def make_latest(checkpoint: Path) -> None:
    """Have LATEST name it, and newer ones, which are damaged, be called so: they are neither what
    the run goes on from nor the good one that is kept. Raises CheckpointError."""
    root = checkpoint.parent
    try:
        for newer in completed(root):
            if newer.name > checkpoint.name:
                shutil.rmtree(root / f"damaged-{newer.name}", ignore_errors=True)
                os.replace(newer, root / f"damaged-{newer.name}")
        (root / f".{LATEST}").write_text(checkpoint.name)
        os.replace(root / f".{LATEST}", root / LATEST)
    except OSError as error:
        raise CheckpointError(f"checkpoint: {root}: {error}") from error


def _candidates(root: Path) -> list[Path]:
    """What LATEST names, then what was written before it, newest first."""
    latest = _latest(root)
    found = completed(root)[::-1]
    if latest is None:
        return found
    return [latest, *(one for one in found if one.name < latest.name)]


def _latest(root: Path) -> Path | None:
    try:
        return find_checkpoint(root)
    except CheckpointError:
        return None
