"""Files that are whole at any moment."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """A path to write to, which becomes `path` at the end, and is gone where that is not reached:
    until then `path` is as it was. Makes the folders that are needed.

    A link stays one. What is no file (/dev/stdout) is itself written to.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path = path.resolve()
    if path.exists() and not path.is_file():
        yield path
        return
    beside = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        yield beside
        beside.replace(path)
    finally:
        with suppress(OSError):
            beside.unlink()


def write_whole(path: Path, text: str) -> None:
    """Write a file by `written_beside`; line ends as they are. An OSError names it."""
    try:
        with written_beside(path) as beside, beside.open("w", newline="") as file:
            file.write(text)
            file.flush()
    except OSError as error:
        error.filename = error.filename or str(path)
        raise
