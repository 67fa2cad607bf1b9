"""Exports episodes as NPZ or Parquet files for notebooks, with a table of them."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.bags.episodes import RecordedEpisode
from pa_ros.bags.errors import BagError
from pa_ros.core.errors import ConfigError, needs_extra
from pa_ros.core.files import written_beside

TABLE = "episodes.csv"
KINDS = ("npz", "parquet")
COLUMNS = ("file", "episode", "evaluation", "steps", "missing_steps", "reward_per_step", "program")


Write = Callable[[Path, Mapping[str, NDArray[Any]]], None]


def export(
    found: Iterable[RecordedEpisode],
    folder: Path,
    numbers: Collection[int] | None = None,
    kind: str = "npz",
) -> int:
    """Write `episode-<n>.<kind>` or `eval-<n>.<kind>` for each episode, then episodes.csv.

    An episode number that was recorded more than once gets `-2`, `-3`, … Returns the number of
    files. Raises BagError if the folder has a table already or the bag lacks some of `numbers`;
    ConfigError for an unknown kind or a missing extra.
    """
    write = _writer(kind)
    if os.path.lexists(folder / TABLE):
        raise BagError(f"export: {folder / TABLE} already exists: name another folder")
    written: dict[str, int] = {}
    rows: list[tuple[object, ...]] = []
    missing = set(numbers or ())
    for episode in found:
        if numbers is not None and episode.number not in numbers:
            continue
        folder.mkdir(parents=True, exist_ok=True)
        stem = f"{'eval' if episode.evaluation else 'episode'}-{episode.number:06d}"
        written[stem] = written.get(stem, 0) + 1
        name = f"{stem}{f'-{written[stem]}' if written[stem] > 1 else ''}.{kind}"
        with written_beside(folder / name) as beside:
            write(beside, episode.arrays())
        rows.append(_line(name, episode))
        missing.discard(episode.number)
    if rows:
        with written_beside(folder / TABLE) as beside, beside.open("w", newline="") as file:
            csv.writer(file).writerows([COLUMNS, *rows])
    if missing:
        raise BagError(
            f"export: the bag does not contain episodes {sorted(missing)}; {len(rows)} others were "
            "written"
        )
    if not rows:
        raise BagError("export: expected episodes, got none", code="bag.foreign")
    return len(rows)


def pyarrow_with_parquet(what: str) -> Any:
    """The package pyarrow. ConfigError without the extra parquet; `what` begins its text."""
    with needs_extra("parquet", what):
        import pyarrow
        import pyarrow.parquet
    return pyarrow


def _writer(kind: str) -> Write:
    if kind not in KINDS:
        raise ConfigError(f"export: expected one of {', '.join(KINDS)}, got {kind!r}")
    if kind == "npz":
        return lambda path, arrays: np.savez_compressed(path, **arrays)  # type: ignore[arg-type]
    pyarrow = pyarrow_with_parquet("export: parquet")

    def write(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write a row for each step; arrays of several axes become lists, flattened by row."""
        columns = {
            name: values if values.ndim == 1 else list(values.reshape(len(values), -1))
            for name, values in arrays.items()
        }
        shapes = {name: values.shape[1:] for name, values in arrays.items()}
        table = pyarrow.table(columns).replace_schema_metadata({"shapes": json.dumps(shapes)})
        pyarrow.parquet.write_table(table, path)

    return write


def _line(name: str, episode: RecordedEpisode) -> tuple[object, ...]:
    rewards = episode.rewards
    mean = f"{rewards.mean():.6g}" if len(rewards) else ""
    steps = len(episode.rows) - 1
    program = episode.rows[-1].step.program
    return name, episode.number, episode.evaluation, steps, episode.missing, mean, program
