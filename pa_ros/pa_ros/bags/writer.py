"""Writes a bag: a folder with one storage file after another, and metadata.yaml at the end."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, NoReturn

from pydantic import Field

from pa_ros.bags.errors import BagError, BagFullError
from pa_ros.bags.format import (
    RESERVE,
    VERSION,
    BagTopic,
    FileContents,
    FolderLock,
    information,
    repair_command,
    write_metadata,
)
from pa_ros.bags.storage import McapStorage
from pa_ros.core import __version__
from pa_ros.core.settings import Settings

RESERVE_BYTES = 2 << 20  # enough for the last chunk, the index and metadata.yaml


class BagOptions(Settings):
    """How a bag is stored. The limits are per storage file."""

    SECTION: ClassVar[str] = "bag"

    split_mb: float = Field(1024.0, ge=0, description="megabytes of each file; 0: any number")
    split_s: float = Field(3600.0, ge=0, description="seconds of each file; 0: any number")


class BagWriter:
    """A rosbag2 bag being written; a context manager that always closes it.

    Memory holds at most one chunk of a megabyte. If the disk is full, the bag is closed with
    everything it received, and this and every later write raise BagFullError.
    """

    def __init__(self, folder: Path, options: BagOptions | None = None) -> None:
        """Raises BagError if `folder` exists, BagFullError if it cannot be created."""
        self.folder = folder
        self.options = options or BagOptions()
        self.counts: dict[str, int] = {}  # messages by topic
        self.custom = {VERSION: __version__}  # custom_data of metadata.yaml, written when closing
        self.failure: BagFullError | None = None
        self._topics: dict[str, tuple[int, BagTopic]] = {}
        self._finished: list[FileContents] = []
        self._finished_bytes = 0
        self._disk_error: OSError | None = None  # the write that needed the reserve
        self._closed = False
        refuse_existing(folder)
        try:
            folder.mkdir(parents=True)
            self._lock = FolderLock(folder)
        except OSError as error:
            raise BagFullError(f"bag: {folder}: {error}") from error
        try:
            with self._reserve.open("xb") as file:
                # This space is freed when the disk is full, so that index and metadata can still be
                # written.
                os.posix_fallocate(file.fileno(), 0, RESERVE_BYTES)
            self._storage = self._next_file()
        except OSError as error:
            self._reserve.unlink(missing_ok=True)
            self._lock.release()
            raise BagFullError(f"bag: {folder}: {error}") from error

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def size(self) -> int:
        """Bytes on disk."""
        return self._finished_bytes + (0 if self._closed else self._storage.size())

    def add(self, topic: BagTopic) -> None:
        """Declare a topic."""
        self._topics[topic.name] = (len(self._topics), topic)
        self.counts[topic.name] = 0
        self._storage.add_topic(topic)

    def write(
        self, name: str, payload: bytes, log_ns: int, sent_ns: int | None = None, sequence: int = 0
    ) -> None:
        """Add a message of a declared topic.

        :param log_ns: wall time of arrival, ns.
        :param sent_ns: wall time of sending, ns.
        :param sequence: the publisher's own count of its messages; 0 if it has none.
        """
        if self.failure is not None:
            raise self.failure
        try:
            if self._split_is_due(log_ns):
                self._finish_file()
                self._storage = self._next_file()
            number = self._topics[name][0]
            sent_ns = log_ns if sent_ns is None else sent_ns
            self._storage.write(number, payload, log_ns, sent_ns, sequence)
        except OSError as error:
            self._give_up(error)
        self._contents.add(name, log_ns)
        self.counts[name] += 1
        self._check_disk()

    def flush(self) -> None:
        """Pass everything on to the operating system, so that a repair finds it after a SIGKILL."""
        if self.failure is not None:
            raise self.failure
        try:
            self._storage.flush()
        except OSError as error:
            self._give_up(error)
        self._check_disk()

    def close(self, custom: Mapping[str, str] | None = None) -> None:
        """Write index and metadata; a second call does nothing. Raises BagFullError."""
        self.custom.update(custom or {})
        if self._closed:
            return
        self._reserve.unlink(missing_ok=True)
        try:
            self._finish_file()
            self._closed = True
            write_metadata(self.folder, self._information(self._finished))
        except OSError as error:
            self._give_up(error)
        self._lock.release()

    @property
    def _reserve(self) -> Path:
        return self.folder / RESERVE

    def _check_disk(self) -> None:
        """Close the bag if the last write succeeded only because the reserve was freed."""
        if self._disk_error is not None:
            self.close()
            self._fail(self._disk_error, "the bag was closed with everything it received")

    def _free_reserve(self, error: OSError) -> bool:
        """Free the reserved space after a failed write; return whether to try once more."""
        if not self._reserve.exists():
            return False
        self._disk_error = error
        self._reserve.unlink()
        return True

    def _next_file(self) -> McapStorage:
        number = f"_{len(self._finished)}" if self._finished else ""
        path = self.folder / f"{self.folder.name}{number}.mcap"
        storage = McapStorage(path, self._free_reserve)
        self._contents = FileContents(path)
        for _, topic in self._topics.values():
            storage.add_topic(topic)
        return storage

    def _split_is_due(self, log_ns: int) -> bool:
        options, contents = self.options, self._contents
        if not contents.counts:
            return False
        full = 0 < options.split_mb * 1e6 <= self._storage.size()
        return full or 0 < options.split_s * 1e9 <= log_ns - contents.first_ns

    def _finish_file(self) -> None:
        self._storage.close(self._information([*self._finished, self._contents]))
        self._finished.append(self._contents)
        self._finished_bytes += self._storage.size()

    def _information(self, files: list[FileContents]) -> dict[str, object]:
        topics = [topic for _, topic in self._topics.values()]
        return information(topics, files, self.custom)

    def _give_up(self, error: Exception) -> NoReturn:
        """Leave the bag as it is on the disk, to be repaired. Always raises BagFullError."""
        self._reserve.unlink(missing_ok=True)
        self._closed = True
        self._storage.abandon()
        self._fail(error, f"{repair_command(self.folder)} makes it readable")

    def _fail(self, error: Exception, rest: str) -> NoReturn:
        self._lock.release()
        self.failure = BagFullError(f"bag: {self.folder}: {error}: {rest}")
        raise self.failure from error


def refuse_existing(folder: Path) -> None:
    """Raise BagError if the path is taken, even by a broken link."""
    if os.path.lexists(folder):
        raise BagError(f"bag: {folder} already exists and is not overwritten: name another folder")
