"""Writes one MCAP file of a bag. Flushed messages survive a SIGKILL."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from pa_ros.bags.format import BagTopic

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
        """The bytes in the file so far."""
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
