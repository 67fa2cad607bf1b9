"""Files that are whole at any moment."""

from __future__ import annotations

from pathlib import Path


def write_whole(path: Path, text: str) -> None:
    """Write a file, and the folders that it needs; until all of it is there it is as it was.

    Line ends are written as they are. What is no file (/dev/stdout) is written to. OSError leaves
    nothing that fills the disk.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path = path.resolve()  # a link stays one
    replaces = path.is_file() or not path.exists()
    into = path.with_name(f"{path.name}.part") if replaces else path
    try:
        with into.open("w", newline="") as file:
            file.write(text)
        if replaces:
            into.replace(path)
    except OSError as error:
        if replaces:
            into.unlink(missing_ok=True)
        error.filename = error.filename or str(path)
        raise
