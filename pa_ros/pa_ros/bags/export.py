"""Episodes as NPZ files for notebooks: one per episode, and a table of them all."""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterable
from pathlib import Path

import numpy as np

from pa_ros.bags.episodes import RecordedEpisode
from pa_ros.bags.errors import BagError

COLUMNS = ("file", "episode", "evaluation", "steps", "missing_steps", "reward_per_step", "program")


def export(
    found: Iterable[RecordedEpisode], folder: Path, numbers: Collection[int] | None = None
) -> int:
    """Write `episode-<n>.npz` (`eval-<n>.npz`) and episodes.csv; how many. BagError if refused.

    An episode that was recorded more than once gets `-2`, `-3`, … behind its number.
    """
    written: dict[str, int] = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "episodes.csv").open("x", newline="") as file:
            table = csv.writer(file)
            table.writerow(COLUMNS)
            for episode in found:
                if numbers is None or episode.number in numbers:
                    name = _name(episode, written)
                    np.savez_compressed(folder / name, **episode.arrays())  # type: ignore[arg-type]
                    table.writerow(_line(name, episode))
    except FileExistsError as error:
        raise BagError(f"export: {error.filename} exists already, not overwriting") from None
    except OSError as error:
        raise BagError(f"export: {error}") from error
    return sum(written.values())


def _name(episode: RecordedEpisode, written: dict[str, int]) -> str:
    stem = f"{'eval' if episode.evaluation else 'episode'}-{episode.number:06d}"
    written[stem] = written.get(stem, 0) + 1
    return f"{stem}{f'-{written[stem]}' if written[stem] > 1 else ''}.npz"


def _line(name: str, episode: RecordedEpisode) -> tuple[object, ...]:
    rewards = episode.rewards
    mean = f"{rewards.mean():.6g}" if len(rewards) else ""
    steps = len(episode.rows) - 1
    program = episode.rows[-1].program
    return name, episode.number, episode.evaluation, steps, episode.missing, mean, program
