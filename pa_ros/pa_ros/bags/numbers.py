"""How many messages were published, by the numbers that their publishers gave them (MCAP)."""

from __future__ import annotations

from pathlib import Path

from mcap.reader import make_reader

from pa_ros.bags.contents import stated
from pa_ros.bags.errors import DamagedBagError
from pa_ros.bags.losses import Losses


def losses_of(path: Path) -> dict[str, Losses]:
    """By topic, what did not come, of topics whose messages have numbers. DamagedBagError.

    Only MCAP keeps the numbers, and a middleware may give none. Each publisher that was heard from
    its first message on is told apart.
    """
    numbers: dict[str, list[int]] = {}
    for file in _files(path):
        if file.suffix == ".mcap":
            try:
                with file.open("rb") as stream:
                    for _, channel, message in make_reader(stream).iter_messages():
                        numbers.setdefault(channel.topic, []).append(message.sequence)
            except Exception as error:  # whatever damaged bytes lead the reader to
                said = f"{type(error).__name__}: {error}"
                raise DamagedBagError(f"bag: {file}: {said}") from error
    return {name: _losses(found) for name, found in numbers.items() if all(found)}


def _files(path: Path) -> list[Path]:
    """Those that the index names; a file is one itself."""
    return [path / str(name) for name in stated(path).get("relative_file_paths", [])] or [path]


def _losses(numbers: list[int]) -> Losses:
    publishers = max(1, numbers.count(1))
    losses = Losses(lambda: publishers)
    for number in numbers:
        losses.take(number)
    return losses
