"""Writing a bag: one folder, one file after the other, and metadata.yaml when it is closed."""

from __future__ import annotations

import errno
import os
import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, NoReturn

from pydantic import Field

from pa_ros.bags.claim import Claim
from pa_ros.bags.contents import (
    RESERVE,
    BagTopic,
    FileContents,
    information,
    repair_command,
    stated,
    write_metadata,
)
from pa_ros.bags.errors import BagError, BagFullError, BagMovedError
from pa_ros.bags.repair import contents_of
from pa_ros.bags.storage import DISK_ERRORS, STORAGES, Storage, storage_named
from pa_ros.bags.tail import finish
from pa_ros.core.settings import OneOf, Settings

RESERVE_BYTES = 2 << 20


class BagOptions(Settings):
    """How a bag is stored. Limits are per file; the index of a file grows with its length."""

    SECTION: ClassVar[str] = "bag"

    storage: Annotated[str, OneOf(lambda: STORAGES)] = Field("mcap", description="format")
    split_mb: float = Field(1024.0, ge=0, description="megabytes of each file; 0: any number")
    split_s: float = Field(3600.0, ge=0, description="seconds of each file; 0: any number")

    @property
    def split_bytes(self) -> int:
        """Most bytes of a file; 0: any number."""
        return int(self.split_mb * 1e6)


class BagWriter:
    """A rosbag2 bag being written; a context manager that closes it, whatever happens.

    Memory holds at most one chunk of a megabyte. If the disk refuses a write, the bag is closed
    readable with what it has, and this and every later write raise BagFullError.
    """

    def __init__(self, folder: Path, options: BagOptions | None = None) -> None:
        """Raises BagError if `folder` exists, BagFullError if it cannot be made."""
        self.folder = folder
        self.options = options or BagOptions()
        self.counts: dict[str, int] = {}  # messages by topic
        self.custom: dict[str, str] = {}  # custom_data of metadata.yaml; set until closing
        self.failure: BagFullError | None = None
        self._storage_type = storage_named(self.options.storage)
        self._topics: dict[str, tuple[int, BagTopic]] = {}
        self._finished: list[FileContents] = []
        self._closed = False
        try:
            folder.mkdir(parents=True)
            self._claim = Claim(folder)
        except FileExistsError:
            raise _exists(folder) from None
        except OSError as error:
            raise BagFullError(f"bag: {folder}: {error}") from error
        try:
            _reserve(folder / RESERVE)
            self._storage: Storage = self._next_file()
        except DISK_ERRORS as error:
            (folder / RESERVE).unlink(missing_ok=True)
            self._claim.release()
            raise BagFullError(f"bag: {folder}: {error}") from error

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def size(self) -> int:
        """Bytes on disk."""
        return self._past_bytes + (0 if self._closed else self._storage.size())

    def add(self, topic: BagTopic) -> None:
        """Declare a topic. BagError if its name is declared already."""
        if topic.name in self._topics:
            raise BagError(f"bag: {topic.name}: declared twice")
        self._topics[topic.name] = (len(self._topics), topic)
        self.counts[topic.name] = 0
        self._storage.add_topic(topic)

    def write(
        self, name: str, payload: bytes, log_ns: int, sent_ns: int | None = None, sequence: int = 0
    ) -> None:
        """Add a message of a declared topic: wall times of arrival and sending, ns."""
        self._check()
        sent_ns = log_ns if sent_ns is None else sent_ns
        try:
            if self._due_to_split(log_ns):
                self._split()
            self._storage.write(self._topics[name][0], payload, log_ns, sent_ns, sequence)
        except DISK_ERRORS as error:
            self._give_up(error)
        self._contents.add(name, log_ns)
        self.counts[name] += 1

    def flush(self) -> None:
        """Hand everything to the operating system: what a SIGKILL then leaves is repairable."""
        self._check()
        try:
            self._storage.flush()
        except DISK_ERRORS as error:
            self._give_up(error)

    def close(self, custom: Mapping[str, str] | None = None) -> None:
        """Write index and metadata; does nothing the second time. Raises BagFullError if the
        disk is full, the bag being readable even so."""
        self.custom.update(custom or {})
        if self._closed:
            return
        (self.folder / RESERVE).unlink(missing_ok=True)
        try:
            self._finish_file()
            self._closed = True
            self._write_metadata()
        except DISK_ERRORS as error:
            self._give_up(error)
        self._claim.release()

    def _check(self) -> None:
        if self.failure is not None:
            raise self.failure
        if self._closed:
            raise BagError(f"bag: {self.folder}: closed already")

    def _next_file(self) -> Storage:
        number = len(self._finished)
        suffix = f"_{number}" if number else ""
        path = self.folder / f"{self.folder.name}{suffix}{self._storage_type.suffix}"
        storage = self._storage_type(path)
        self._contents = FileContents(path)
        self._past_bytes = sum(file.path.stat().st_size for file in self._finished)
        for _, topic in self._topics.values():
            storage.add_topic(topic)
        return storage

    def _due_to_split(self, log_ns: int) -> bool:
        options, contents = self.options, self._contents
        if not contents.counts:
            return False
        full = 0 < options.split_bytes <= self._storage.size()
        return full or 0 < options.split_s * 1e9 <= log_ns - contents.first_ns

    def _split(self) -> None:
        self._finish_file()
        self._storage = self._next_file()

    def _finish_file(self) -> None:
        about = self._information([*self._finished, self._contents])
        self._storage.close(about)
        self._finished.append(self._contents)
        self._past_bytes = sum(file.path.stat().st_size for file in self._finished)

    def _information(self, files: list[FileContents]) -> dict[str, object]:
        topics = [topic for _, topic in self._topics.values()]
        return information(self.options.storage, topics, files, self.custom)

    def _write_metadata(self) -> None:
        write_metadata(self.folder, self._information(self._finished))

    def _give_up(self, error: Exception) -> NoReturn:
        """Close with what is on the disk, using the space set aside. Always raises."""
        (self.folder / RESERVE).unlink(missing_ok=True)
        path = self._storage.path
        if not self._closed:
            self._closed = True
            self._storage.abandon()
        if not path.exists():
            self._fail(BagMovedError(
                f"bag: {self.folder}: the folder was moved or deleted while it was recorded: "
                "where it went, `pa_ros record --repair FOLDER` makes it whole"
            ), error)  # fmt: skip
        files = [file for file in self._finished if file.path != path]
        try:
            if self.options.storage == "mcap":
                finish(path)
            self._finished = [*files, contents_of(path)[1]]
            self._write_metadata()
            kept = sum(file.total for file in self._finished)
            rest = f"{kept} messages are in the bag, which was closed"
        except (BagError, *DISK_ERRORS) as second:
            where = " where there is space" if _lacks_space(second) else ""
            rest = (
                f"and the bag could not be closed ({second}): {repair_command(self.folder)}{where}"
            )
        self._fail(BagFullError(f"bag: {self.folder}: {error}: {rest}"), error)

    def _fail(self, failure: BagFullError, cause: Exception) -> NoReturn:
        self._claim.release()
        self.failure = failure
        raise failure from cause


def refuse_existing(folder: Path) -> None:
    """Raise BagError if there is something already."""
    if os.path.lexists(folder):
        raise _exists(folder)


def refuse_bag(folder: Path) -> None:
    """Raise BagError if a folder for other files is a bag's, whole or not."""
    suffixes = {kind.suffix for kind in STORAGES.values()}
    files = folder.iterdir() if folder.is_dir() else ()
    if stated(folder) or any(path.suffix in suffixes for path in files):
        raise BagError(f"bag: {folder}: expected a folder for other files, got a bag's")


def _exists(folder: Path) -> BagError:
    return BagError(f"bag: {folder} exists already, not overwriting")


def _lacks_space(error: BaseException | None) -> bool:
    """Whether the disk was full, or what one may use of it."""
    if isinstance(error, BagError):
        return _lacks_space(error.__cause__)
    full = getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL
    return full or getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT)


def _reserve(path: Path) -> None:
    with path.open("xb") as file:
        os.posix_fallocate(file.fileno(), 0, RESERVE_BYTES)
