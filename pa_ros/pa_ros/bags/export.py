"""Episodes as NPZ or Parquet files for notebooks: one per episode, and a table of them all."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.bags.episodes import RecordedEpisode
from pa_ros.bags.errors import BagError
from pa_ros.core.errors import ConfigError

KINDS = ("npz", "parquet")
COLUMNS = ("file", "episode", "evaluation", "steps", "missing_steps", "reward_per_step", "program")


Write = Callable[[Path, Mapping[str, NDArray[Any]]], None]


def export(
    found: Iterable[RecordedEpisode],
    folder: Path,
    numbers: Collection[int] | None = None,
    kind: str = "npz",
) -> int:
    """Write `episode-<n>.<kind>` (`eval-<n>.<kind>`) and episodes.csv; how many.

    An episode that was recorded more than once gets `-2`, `-3`, … behind its number. BagError if
    refused, or, with the others written, if the bag has not all of `numbers`; ConfigError if the
    kind is none of KINDS or lacks its extra.
    """
    write = _writer(kind)
    written, missing = dict[str, int](), set(numbers or ())
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "episodes.csv").open("x", newline="") as file:
            table = csv.writer(file)
            table.writerow(COLUMNS)
            for episode in found:
                if numbers is None or episode.number in numbers:
                    name = _name(episode, written, kind)
                    write(folder / name, episode.arrays())
                    table.writerow(_line(name, episode))
                    missing.discard(episode.number)
    except FileExistsError as error:
        raise BagError(f"export: {error.filename} exists already, not overwriting") from None
    except OSError as error:
        raise BagError(f"export: {error}") from error
    if missing:
        raise BagError(
            f"export: {folder}: expected episodes that the bag has, got {sorted(missing)}, too; "
            f"{sum(written.values())} others are there"
        )
    return sum(written.values())


def _writer(kind: str) -> Write:
    if kind not in KINDS:
        raise ConfigError(f"export: expected one of {', '.join(KINDS)}, got {kind!r}")
    if kind == "npz":
        return lambda path, arrays: np.savez_compressed(path, **arrays)  # type: ignore[arg-type]
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise ConfigError(
            "export: parquet: expected the extra parquet (pip install "
            f'"programmable-agents[parquet]"), got: {error}'
        ) from error

    def write(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        """A row for each step; what is an array there is a list, row by row of the array."""
        columns = {
            name: values if values.ndim == 1 else list(values.reshape(len(values), -1))
            for name, values in arrays.items()
        }
        shapes = {name: values.shape[1:] for name, values in arrays.items()}
        table = pyarrow.table(columns).replace_schema_metadata({"shapes": json.dumps(shapes)})
        pyarrow.parquet.write_table(table, path)

    return write


def _name(episode: RecordedEpisode, written: dict[str, int], kind: str) -> str:
    stem = f"{'eval' if episode.evaluation else 'episode'}-{episode.number:06d}"
    written[stem] = written.get(stem, 0) + 1
    return f"{stem}{f'-{written[stem]}' if written[stem] > 1 else ''}.{kind}"


def _line(name: str, episode: RecordedEpisode) -> tuple[object, ...]:
    rewards = episode.rewards
    mean = f"{rewards.mean():.6g}" if len(rewards) else ""
    steps = len(episode.rows) - 1
    program = episode.rows[-1].program
    return name, episode.number, episode.evaluation, steps, episode.missing, mean, program
