"""Files that are complete at any moment, and files that one process has for itself."""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """A path to write to, which replaces `path` at the end of the block.

    If the block fails, `path` stays as it was, and an OSError names it. Missing folders are made. A
    symbolic link stays one. A path that is not a regular file (/dev/stdout) is written directly.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path = path.resolve()
    if path.exists() and not path.is_file():
        yield path
        return
    # In the same folder, because only a rename within one file system is atomic.
    beside = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        yield beside
        beside.replace(path)
    except OSError as error:
        if error.errno is not None:
            error.filename = error.filename or str(path)
        raise
    finally:
        with suppress(OSError):
            beside.unlink()


def write_whole(path: Path, text: str) -> None:
    """Write a file by `written_beside`, with line ends as they are."""
    with written_beside(path) as beside, beside.open("w", newline="") as file:
        file.write(text)


def sync(descriptor: int) -> None:
    """Write an open file or folder through to the disk.

    A file system that cannot sync it (CIFS and some virtual ones say so of folders) does without.
    """
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.ENOSYS, errno.EBADF):
            raise


def take_lock(descriptor: int) -> bool:
    """Lock an open file or folder until it is closed or the process ends.

    Returns False if another process has locked it. A file system without locks grants every lock.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True
