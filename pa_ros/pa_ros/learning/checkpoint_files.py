"""How checkpoints lie on disk: whole at any moment, with checksums, and never unpickled.

Under one root, each checkpoint is a folder `version-…` of safetensors files and metadata.json. It
is written under another name, synced, and renamed when complete. The file LATEST names the newest
one and is replaced atomically. So a crash at any moment leaves a whole checkpoint.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import struct
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file

from pa_ros.core.files import sync
from pa_ros.learning.errors import CheckpointError

LATEST = "LATEST"
METADATA = "metadata.json"
SUMS = "SHA256SUMS"  # as `sha256sum` writes it; `sha256sum --check` reads it
SHIPPED = Path(__file__).parents[1] / "shipped"
SHIPPED_PREFIX = "shipped:"

Arrays = dict[str, NDArray[Any]]
Pieces = Sequence[Any]  # of a file's content, in turn: bytes, or arrays of bytes


def shipped_names() -> list[str]:
    """Names of the policies that come with the package."""
    return sorted(card.parent.name for card in SHIPPED.glob(f"*/{METADATA}"))


def find_checkpoint(path: Path) -> Path:
    """The checkpoint folder that `path` is, or that its LATEST names, also in a run's folder.

    "shipped:NAME" is a policy that comes with the package. Raises CheckpointError if there is none.
    """
    if str(path).startswith(SHIPPED_PREFIX):
        name = str(path).removeprefix(SHIPPED_PREFIX)
        names = shipped_names()
        if name not in names:
            raise CheckpointError(f"checkpoint: expected shipped: and one of {names}, got {name!r}")
        return SHIPPED / name
    if os.path.isfile(path / METADATA):
        return path
    if (path / "checkpoint").is_dir():
        path /= "checkpoint"
    named = latest_name(path)
    if not named or Path(named).name != named or not os.path.isfile(path / named / METADATA):
        raise CheckpointError(f"checkpoint: expected one at {path}, found none")
    return path / named


def completed(root: Path) -> list[Path]:
    """The checkpoints under a root, oldest first, damaged or not."""
    names = (path for path in root.glob("version-*") if re.fullmatch(r"version-\d{9,}", path.name))
    return sorted(path for path in names if path.is_dir())


def write_checkpoint(root: Path, name: str, files: Mapping[str, Pieces]) -> None:
    """Write a checkpoint's files and checksums and make it the latest.

    The checkpoint before it is kept, older ones are removed. Raises CheckpointError if it cannot be
    written; then nothing of it is left to fill the disk.
    """
    try:
        root.mkdir(parents=True, exist_ok=True)
        unfinished, finished = root / f".{name}", root / name
        for leftover in (unfinished, finished):  # of a crash; LATEST names neither
            shutil.rmtree(leftover, ignore_errors=True)
        unfinished.mkdir()
        sums = (f"{write_synced(unfinished / one, *files[one])}  {one}\n" for one in files)
        write_synced(unfinished / SUMS, "".join(sums).encode())
        # The content must be on the disk before the rename is, or a power cut could leave a
        # finished name with empty files.
        _sync_folder(unfinished)
        os.rename(unfinished, finished)
        _sync_folder(root)
        write_synced(root / f".{LATEST}", name.encode())
        os.replace(root / f".{LATEST}", root / LATEST)
        _sync_folder(root)
        remove_older(root, name)
    except OSError as error:
        shutil.rmtree(root / f".{name}", ignore_errors=True)
        # If LATEST names it already, the checkpoint is whole, and only the removal of older ones
        # failed.
        if latest_name(root) != name:
            shutil.rmtree(root / name, ignore_errors=True)
        raise CheckpointError(f"checkpoint: {root}: {error}") from error


def remove_older(root: Path, name: str) -> None:
    """Keep the checkpoint `name` and the one before it; remove others and unfinished ones."""
    others = [path for path in completed(root) if path.name != name]
    before = [path for path in others if path.name < name][-1:]
    unfinished = [path for path in root.glob(".version-*") if path.is_dir()]
    for path in (*others, *unfinished):
        if path not in before:  # what cannot be removed is no reason to end a run
            shutil.rmtree(path, ignore_errors=True)


def newest_whole(root: Path) -> tuple[Path, str]:
    """The newest undamaged checkpoint under a root, and a description of newer damage or "".

    Raises CheckpointError, naming each damage, if none is whole.
    """
    try:
        latest = find_checkpoint(root)
        damages = []
        candidates = [latest, *(p for p in completed(root)[::-1] if p.name < latest.name)]
    except CheckpointError:
        candidates = completed(root)[::-1]
        damages = [f"checkpoint: {root / LATEST}: names no checkpoint"] if candidates else []
    for directory in candidates:
        try:
            check_files(directory)
            find_checkpoint(directory)
        except CheckpointError as error:
            damages.append(str(error))
            continue
        if damages:
            damages.append(f"the run resumes from {directory.name}")
        return directory, "; ".join(damages)
    raise CheckpointError("; ".join(damages) or f"checkpoint: expected one at {root}, found none")


def make_latest(checkpoint: Path) -> None:
    """Let LATEST name a checkpoint, and rename newer ones, which are damaged, to damaged-….

    Raises CheckpointError.
    """
    root = checkpoint.parent
    try:
        # The resumed run will use these version numbers again, so the damaged ones must give them
        # up.
        for newer in completed(root):
            if newer.name > checkpoint.name:
                shutil.rmtree(root / f"damaged-{newer.name}", ignore_errors=True)
                os.replace(newer, root / f"damaged-{newer.name}")
        write_synced(root / f".{LATEST}", checkpoint.name.encode())
        os.replace(root / f".{LATEST}", root / LATEST)
    except OSError as error:
        raise CheckpointError(f"checkpoint: {root}: {error}") from error


def check_files(directory: Path, names: Collection[str] = ()) -> None:
    """Raise CheckpointError, naming the file, if one of `names` is damaged; by default, any file of
    the checkpoint. Other files in its folder do not matter.

    A flipped bit in a weight is a finite number, too; only a checksum shows it. Shipped policies
    have no checksums: the package manager checked them.
    """
    sums = directory / SUMS
    if not sums.exists():
        return
    try:
        text = sums.read_text("ascii")
        lines = [line.split("  ", 1) for line in text.splitlines()]
        stated = {name: digest for digest, name in lines}
        for name in names or {METADATA, *stated}:
            found = _digest(directory / name)
            if found != stated.get(name):
                raise CheckpointError(
                    f"checkpoint: {directory / name}: expected SHA-256 {stated.get(name)}, "
                    f"got {found}: the file is damaged"
                )
    except (OSError, ValueError) as error:
        raise CheckpointError(f"checkpoint: {directory}: {SUMS}: {error}") from error


def packed(arrays: Arrays) -> Pieces:
    """Content of a safetensors file: a header, and views of the arrays."""
    # The library would copy all arrays twice, so a full replay buffer would not fit in memory.
    # The largest numbers come first, as there, so that each array is aligned.
    content = {k: np.asarray(v, order="C") for k, v in arrays.items()}
    names = sorted(content, key=lambda name: (-content[name].itemsize, name))
    header, end = {}, 0
    for name in names:
        array = content[name]
        kind = f"{array.dtype.kind.upper()}{8 * array.itemsize}".replace("B8", "BOOL")
        offsets = [end, end := end + array.nbytes]
        header[name] = {"dtype": kind, "shape": array.shape, "data_offsets": offsets}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    flat = (content[name].ravel().view(np.uint8) for name in names)
    return [struct.pack("<Q", len(text)), text, *flat]


def load_arrays(path: Path) -> Arrays:
    """Arrays of a safetensors file, owned by the caller. Raises CheckpointError."""
    try:
        arrays: Arrays = load_file(path)
    except (OSError, SafetensorError, ValueError) as error:
        raise CheckpointError(f"checkpoint: {path}: {error}") from error
    return {name: np.array(array) for name, array in arrays.items()}


def write_synced(path: Path, *pieces: Any) -> str:
    """Write a file, bytes or arrays of bytes in turn, through to the disk; its SHA-256."""
    digest = hashlib.sha256()
    with path.open("wb") as file:
        for piece in pieces:
            file.write(piece)
            digest.update(piece)
        file.flush()
        sync(file.fileno())
    return digest.hexdigest()


def _digest(path: Path) -> str:
    if not path.is_file():
        raise OSError(f"{path}: expected a regular file")
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _sync_folder(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        sync(descriptor)
    finally:
        os.close(descriptor)


def latest_name(root: Path) -> str:
    """Name of the checkpoint that LATEST names; empty: none."""
    try:
        return (root / LATEST).read_text("ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""
