"""Episodes as NPZ or Parquet files for notebooks: one per episode, and a table of them all."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.bags.episodes import RecordedEpisode
from pa_ros.bags.errors import BagError, ForeignBagError
from pa_ros.bags.writer import refuse_bag
from pa_ros.core.errors import ConfigError, PaError

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
    """Write `episode-<n>.<kind>` (`eval-<n>.<kind>`) and episodes.csv; how many.

    An episode that was recorded more than once gets `-2`, `-3`, … behind its number. Until all is
    written the table is called episodes.csv.part; where nothing is, nothing is left.
    ForeignBagError if there are no episodes, BagError if refused, as a bag's own folder is, or,
    with the others written, if the bag has not all of `numbers` or can't be read to its end;
    ConfigError if the kind is none of KINDS or lacks its extra.
    """
    write = _writer(kind)
    refuse_bag(folder)
    table, unfinished = folder / TABLE, folder / f"{TABLE}.part"
    if os.path.lexists(table):
        raise BagError(f"export: {table} exists already, not overwriting")
    made = [one for one in (folder, *folder.parents) if not os.path.lexists(one)]
    written, missing = dict[str, int](), set(numbers or ())
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with unfinished.open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(COLUMNS)
            for episode in found:
                if numbers is None or episode.number in numbers:
                    name = _name(episode, written, kind)
                    write(folder / name, episode.arrays())
                    rows.writerow(_line(name, episode))
                    missing.discard(episode.number)
        if written:
            unfinished.replace(table)
    except (PaError, OSError) as error:
        count = max(0, sum(written.values()) - isinstance(error, OSError))
        said = f"; {count} episodes are in {folder}, their table is {unfinished.name}"
        raise BagError(f"export: {error}{said if count else ''}") from error
    finally:
        if not written:
            _leave_nothing(unfinished, made)
    count = sum(written.values())
    if missing:
        rest = f"{count} others are there" if count else "none was written"
        raise BagError(
            f"export: {folder}: expected episodes that the bag has, got {sorted(missing)}"
            f"{', too' if count else ''}; {rest}"
        )
    if not count:
        raise ForeignBagError("export: expected episodes, got none")
    return count


def _leave_nothing(unfinished: Path, made: Iterable[Path]) -> None:
    """Remove an empty table, and the folders that were made for it."""
    with suppress(OSError):
        unfinished.unlink()
    for folder in made:
        with suppress(OSError):
            folder.rmdir()


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
