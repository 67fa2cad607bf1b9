"""How learning goes: the learning curve as a CSV file, and scalars for TensorBoard."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from pa_ros.core.errors import ConfigError, needs_extra
from pa_ros.core.files import write_whole
from pa_ros.learning.errors import CheckpointError, LearningError

Row = Mapping[str, float] | Mapping[str, str]


class ProgressLog:
    """Rows of a CSV file that is whole at any moment.

    When resuming, rows after `frames` are dropped: that part of the run is repeated.
    """

    def __init__(self, path: Path, resume_frames: int | None = None) -> None:
        """CheckpointError, with the file as it was, if it can't be read or written."""
        self._path = path
        self._rows: list[Row] = [] if resume_frames is None else self._rows_until(resume_frames)
        self.write()

    def add(self, row: Row) -> None:
        """Append a row. OSError if there is no room for it; the next row writes it, too."""
        self._rows.append(row)
        self._write()

    def write(self) -> None:
        """CheckpointError if there is no room for all rows."""
        try:
            self._write()
        except OSError as error:
            raise CheckpointError(f"progress: {self._path}: {error}") from error

    def _write(self) -> None:
        file = io.StringIO(newline="")
        # A resumed run may have other columns than before, such as those of an evaluation.
        columns = list(dict.fromkeys(name for row in self._rows for name in row))
        if columns:
            writer = csv.DictWriter(file, columns, restval="nan")
            writer.writeheader()
            writer.writerows(self._rows)
        write_whole(self._path, file.getvalue())

    def _rows_until(self, frames: int) -> list[Row]:
        if not self._path.exists():
            return []
        try:
            with self._path.open(newline="") as file:
                return [row for row in csv.DictReader(file) if float(row["frames"]) <= frames]
        except (OSError, KeyError, ValueError, TypeError, csv.Error) as error:
            raise CheckpointError(f"progress: {self._path}: {error!r}") from error


class Scalars:
    """Writes a learner's metrics where TensorBoard reads them (extra `tensorboard`).

    Frames are the horizontal axis, so a resumed run continues its curves.
    """

    def __init__(self, folder: Path) -> None:
        """Raises ConfigError without the package, or if the folder cannot be written."""
        with needs_extra("tensorboard", "tensorboard"):
            from torch.utils.tensorboard import SummaryWriter
        try:
            self._writer: Any = SummaryWriter(str(folder))  # type: ignore[no-untyped-call]
        except OSError as error:
            raise ConfigError(f"tensorboard: expected a folder to write to: {error}") from error
        self._frames = -1.0

    def add(self, metrics: Mapping[str, float]) -> None:
        """Write `Learner.metrics`, unless there are no new frames.

        LearningError if the disk is full; nothing more may be added then.
        """
        if metrics["frames"] == self._frames:
            return
        self._frames = metrics["frames"]
        try:
            for name in metrics.keys() - {"frames"}:
                self._writer.add_scalar(f"learner/{name}", metrics[name], int(self._frames))
            self._writer.flush()
        except OSError as error:
            raise LearningError(
                f"tensorboard: expected room for more: {error}", code="learning.tensorboard"
            ) from error

    def close(self) -> None:
        """End the writer's thread; what there is no room for is left out."""
        with suppress(OSError):
            self._writer.file_writer.close()
