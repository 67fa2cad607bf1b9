"""The learning curve as a tidy CSV file, one row per report."""

from __future__ import annotations

import csv
from pathlib import Path

from pa_ros.learning.errors import CheckpointError


class Progress:
    """Appends rows to a CSV file; the first row fixes the columns.

    When resuming, rows after `frames` are dropped: that part of the run is repeated.
    """

    def __init__(self, path: Path, resume_frames: int | None = None) -> None:
        self._path = path
        self._columns: list[str] | None = None
        kept = self._rows_until(resume_frames) if resume_frames is not None else []
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
        for row in kept:
            self.add(row)

    def add(self, row: dict[str, float] | dict[str, str]) -> None:
        """Write one row; CheckpointError if its columns are not the first row's."""
        if self._columns is not None and self._columns != list(row):
            raise CheckpointError(
                f"progress: {self._path}: expected columns {self._columns}, got {list(row)}"
            )
        with self._path.open("a", newline="") as file:
            writer = csv.DictWriter(file, self._columns or list(row))
            if self._columns is None:
                self._columns = list(row)
                writer.writeheader()
            writer.writerow(row)

    def _rows_until(self, frames: int) -> list[dict[str, str]]:
        if not self._path.exists():
            return []
        try:
            with self._path.open(newline="") as file:
                return [row for row in csv.DictReader(file) if float(row["frames"]) <= frames]
        except (KeyError, ValueError, TypeError) as error:
            raise CheckpointError(f"progress: {self._path}: {error!r}") from error
