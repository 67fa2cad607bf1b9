"""Learning curves of seeds: what `pa_ros.learning.progress` wrote, as numbers."""

from __future__ import annotations

import csv
from pathlib import Path

from pa_ros.learning.errors import CheckpointError

CURVE = "progress.csv"  # in a seed's folder
_CURVE_COLUMNS = {"frames", "wall_s", "train_greedy.normalized"}  # of each, at least


def read_curve(path: Path) -> list[dict[str, float]]:
    """Rows of a progress.csv; CheckpointError if it cannot be read as one."""
    try:
        with path.open(newline="") as file:
            rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    except (OSError, ValueError, TypeError, csv.Error) as error:
        raise CheckpointError(f"curve: {path}: {error!r}") from error
    if rows and not rows[0].keys() >= _CURVE_COLUMNS:
        raise CheckpointError(
            f"curve: {path}: expected columns {sorted(_CURVE_COLUMNS)}, got {list(rows[0])}"
        )
    return rows


def frames_done(path: Path) -> float:
    """Frames that a progress.csv has reached; 0 if there is none."""
    rows = read_curve(path) if path.exists() else []
    return rows[-1]["frames"] if rows else 0.0
