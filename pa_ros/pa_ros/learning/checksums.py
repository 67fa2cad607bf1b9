"""Checksums of a checkpoint's files: a flipped bit in a weight is a finite number, too.

The file is what `sha256sum` writes and `sha256sum --check` reads.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from pathlib import Path

from pa_ros.learning.errors import CheckpointError

SUMS = "SHA256SUMS"


def checksums(files: Mapping[str, bytes]) -> bytes:
    """Contents of SHA256SUMS for these files."""
    return "".join(
        f"{hashlib.sha256(content).hexdigest()}  {name}\n" for name, content in files.items()
    ).encode()


def check_files(directory: Path, names: Collection[str] = ()) -> None:
    """Raise CheckpointError, naming the file, unless these are as they were written (none: all).

    A checkpoint without SHA256SUMS, of a version that wrote none, passes.
    """
    sums = directory / SUMS
    if not sums.exists():
        return
    try:
        lines = [line.split("  ", 1) for line in sums.read_text("ascii").splitlines()]
        stated = {name: digest for digest, name in lines if Path(name).name == name}
        found = {name: hashlib.sha256((directory / name).read_bytes()).hexdigest()
                 for name in names or stated}  # fmt: skip
    except (OSError, ValueError) as error:
        raise CheckpointError(f"checkpoint: {directory}: {SUMS}: {error}") from error
    wrong = [name for name in found if found[name] != stated.get(name)]
    if not names:  # lines may be missing, too
        wrong += sorted(path.name for path in directory.glob("*.*") if path.name not in stated)
    if wrong or not found:
        name = wrong[0] if wrong else SUMS
        raise CheckpointError(
            f"checkpoint: {directory / name}: expected SHA-256 {stated.get(name, 'of each file')}, "
            f"got {found.get(name, 'none')}: the file is damaged"
        )
