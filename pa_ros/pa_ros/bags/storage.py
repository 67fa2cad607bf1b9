"""One file of a bag being written: MCAP or SQLite. What is flushed survives a SIGKILL."""

from __future__ import annotations

import os
import sqlite3
from pathlib import Path
from typing import Any, Protocol

import yaml
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

from pa_ros.bags.contents import BAG_VERSION, BagTopic
from pa_ros.core.errors import ConfigError

CHUNK_BYTES = 1 << 20  # kept in memory at most, and flushed earlier once a second


class Storage(Protocol):
    """What a bag's writer asks of a file. Numbers are of topics, in the order added."""

    path: Path

    def add_topic(self, topic: BagTopic) -> None:
        """Declare a topic; before its first message."""

    def write(self, number: int, payload: bytes, log_ns: int, sent_ns: int, sequence: int) -> None:
        """Add a message: when it came, when it was sent (wall time), the sender's count."""

    def flush(self) -> None:
        """Hand everything to the operating system."""

    def size(self) -> int:
        """Bytes in the file so far."""

    def close(self, information: dict[str, Any]) -> None:
        """Write the index and what metadata.yaml says, and close."""

    def abandon(self) -> None:
        """Close without another byte."""


class _File:
    """An unbuffered file that a failed write leaves as it was before."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        self._end = 0

    def write(self, content: bytes) -> int:
        rest = memoryview(content)
        try:
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError:
            os.ftruncate(self._descriptor, self._end)
            os.lseek(self._descriptor, self._end, os.SEEK_SET)
            raise
        self._end += len(content)
        return len(content)

    def tell(self) -> int:
        return self._end

    def flush(self) -> None:
        """Nothing is buffered here."""

    def close(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1


class McapStorage:
    """MCAP as rosbag2_storage_mcap writes it: profile ros2, type hash and QoS with the channel."""

    suffix = ".mcap"

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = _File(path)
        output: Any = self._file
        self._writer = McapWriter(output, CHUNK_BYTES, CompressionType.NONE)
        self._writer.start("ros2", "pa_ros")
        self._schemas: dict[str, int] = {}
        self._channels: list[int] = []

    def add_topic(self, topic: BagTopic) -> None:
        if topic.type_name not in self._schemas:
            self._schemas[topic.type_name] = self._writer.register_schema(
                topic.type_name, "ros2msg", topic.definition.encode()
            )
        about = {"offered_qos_profiles": topic.qos_text, "topic_type_hash": topic.digest}
        schema = self._schemas[topic.type_name]
        self._channels.append(self._writer.register_channel(topic.name, "cdr", schema, about))

    def write(self, number: int, payload: bytes, log_ns: int, sent_ns: int, sequence: int) -> None:
        channel = self._channels[number]
        self._writer.add_message(channel, log_ns, payload, sent_ns, sequence & 0xFFFFFFFF)

    def flush(self) -> None:
        self._writer.flush()

    def size(self) -> int:
        return self._file.tell()

    def close(self, information: dict[str, Any]) -> None:
        text = yaml.safe_dump(information, sort_keys=False)
        self._writer.flush()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": text})
        self._writer.finish()
        self._file.close()

    def abandon(self) -> None:
        self._file.close()


class SqliteStorage(Sqlite3Writer):  # type: ignore[misc, unused-ignore]
    """SQLite as rosbag2_storage_sqlite3 writes it (rosbags' schema), committed at flushes."""

    suffix = ".db3"

    def __init__(self, path: Path) -> None:
        self.path = path
        # Written by the thread that records, closed by the one that leaves the context.
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
        del sent_ns, sequence  # this format has no place for them
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


STORAGES: dict[str, type[McapStorage] | type[SqliteStorage]] = {
    "mcap": McapStorage,
    "sqlite3": SqliteStorage,
}
DISK_ERRORS = (OSError, sqlite3.OperationalError)


def storage_named(name: str) -> type[McapStorage] | type[SqliteStorage]:
    """Look up a storage; ConfigError names the known ones."""
    if name not in STORAGES:
        raise ConfigError(f"bag storage: expected one of {sorted(STORAGES)}, got {name!r}")
    return STORAGES[name]
