"""Writes one storage file of a bag, MCAP or SQLite. Flushed messages survive a SIGKILL."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

from pa_ros.bags.format import BAG_VERSION, BagTopic

CHUNK_BYTES = 1 << 20  # most bytes in memory before a chunk is written
Retry = Callable[[OSError], bool]
"""Called when a write fails; returns whether there is now space to try once more."""


class _File:
    """An unbuffered file. A failed write is taken back, so that the file stays readable."""

    def __init__(self, path: Path, retry: Retry) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        self._retry, self._end = retry, 0

    def write(self, content: bytes) -> int:
        try:
            self._append(content)
        except OSError as error:
            if not self._retry(error):
                raise
            self._append(content)
        return len(content)

    def _append(self, content: bytes) -> None:
        rest = memoryview(content)
        try:
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError:
            os.ftruncate(self._descriptor, self._end)
            os.lseek(self._descriptor, self._end, os.SEEK_SET)
            raise
        self._end += len(content)

    def tell(self) -> int:
        return self._end

    def flush(self) -> None:
        """Do nothing: nothing is buffered here."""

    def close(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1


class McapStorage:
    """An MCAP file as rosbag2_storage_mcap writes it: QoS and type hash are in the channel."""

    suffix = ".mcap"

    def __init__(self, path: Path, retry: Retry) -> None:
        self.path = path
        self._file = _File(path, retry)
        output: Any = self._file
        self._writer = McapWriter(output, CHUNK_BYTES, CompressionType.NONE)
        self._writer.start("ros2", "pa_ros")
        self._schemas: dict[str, int] = {}
        self._channels: list[int] = []

    def add_topic(self, topic: BagTopic) -> None:
        """Declare a topic, before its first message. Topics are numbered in this order."""
        if topic.type_name not in self._schemas:
            self._schemas[topic.type_name] = self._writer.register_schema(
                topic.type_name, "ros2msg", topic.definition.encode()
            )
        about = {"offered_qos_profiles": topic.qos_text, "topic_type_hash": topic.digest}
        schema = self._schemas[topic.type_name]
        self._channels.append(self._writer.register_channel(topic.name, "cdr", schema, about))

    def write(self, number: int, payload: bytes, log_ns: int, sent_ns: int, sequence: int) -> None:
        """Add a message: wall times of arrival and sending, and the publisher's own count."""
        channel = self._channels[number]
        self._writer.add_message(channel, log_ns, payload, sent_ns, sequence & 0xFFFFFFFF)

    def flush(self) -> None:
        """Pass everything on to the operating system."""
        self._writer.flush()

    def size(self) -> int:
        """Return the bytes in the file so far."""
        return self._file.tell()

    def close(self, information: dict[str, Any]) -> None:
        """Write the index and a copy of the metadata, and close."""
        text = yaml.safe_dump(information, sort_keys=False)
        self._writer.flush()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": text})
        self._writer.finish()
        self._file.close()

    def abandon(self) -> None:
        """Close without writing anything more."""
        self._file.close()


class SqliteStorage(Sqlite3Writer):  # type: ignore[misc, unused-ignore]
    """An SQLite file as rosbag2_storage_sqlite3 writes it, with rosbags' schema.

    Messages are committed when the file is flushed. SQLite itself goes back to the last commit
    when a write fails.
    """

    suffix = ".db3"

    def __init__(self, path: Path, retry: Retry) -> None:
        del retry
        self.path = path
        # The recorder's thread writes; the thread that leaves the context closes.
        self.conn = sqlite3.connect(path, check_same_thread=False)
        self.conn.execute("PRAGMA synchronous = NORMAL")
        self.conn.executescript(self.SQLITE_SCHEMA)
        self.cursor = self.conn.cursor()
        self._types: set[str] = set()
        self._topics = 0

    def add_topic(self, topic: BagTopic) -> None:
        if topic.type_name not in self._types:
            self._types.add(topic.type_name)
            self.cursor.execute(
                "INSERT INTO message_definitions (topic_type, encoding,"
                " encoded_message_definition, type_description_hash) VALUES (?, 'ros2msg', ?, ?)",
                (topic.type_name, topic.definition, topic.digest),
            )
        self._topics += 1
        row = (self._topics, topic.name, topic.type_name, "cdr", topic.qos_text, topic.digest)
        self.cursor.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)", row)

    def write(  # type: ignore[override]
        self, number: int, payload: bytes, log_ns: int, sent_ns: int, sequence: int
    ) -> None:
        del sent_ns, sequence  # SQLite bags have no columns for these
        self.cursor.execute(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
            (number + 1, log_ns, payload),
        )

    def flush(self) -> None:
        self.conn.commit()

    def size(self) -> int:
        return self.path.stat().st_size

    def close(self, information: dict[str, Any]) -> None:  # type: ignore[override]
        super().close(BAG_VERSION, yaml.safe_dump(information, sort_keys=False))

    def abandon(self) -> None:
        try:
            self.abort()
        except sqlite3.Error:
            self.conn.close()


STORAGES: dict[str, type[McapStorage | SqliteStorage]] = {
    "mcap": McapStorage,
    "sqlite3": SqliteStorage,
}
DISK_ERRORS = (OSError, sqlite3.OperationalError)
