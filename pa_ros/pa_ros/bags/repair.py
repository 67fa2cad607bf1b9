"""Repairs a bag whose recorder was killed: finishes its files and writes metadata.yaml."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.records import Channel, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2.storage_mcap import McapReader

from pa_ros.bags.errors import BagError, BagFullError
from pa_ros.bags.format import (
    REPAIRED,
    RESERVE,
    BagTopic,
    FileContents,
    FolderLock,
    custom_data,
    damaged,
    information,
    read_metadata,
    write_metadata,
)
from pa_ros.wire.definitions import hash_of

_SUFFIXES = (".mcap", ".db3")
_CHUNK_BYTES = 1 << 20
KEPT = ".original"  # suffix of a file as it was before a repair


@dataclass(frozen=True)
class Repaired:
    """The findings of a repair."""

    messages: int
    files: int
    notes: tuple[str, ...]  # what was cut off, file by file


def repair(folder: Path) -> Repaired:
    """Make a bag readable. A bag that needs no repair keeps its files.

    Raises BagError if there is nothing to repair, or while the bag is being recorded.
    """
    files = storage_files(folder)
    try:
        about = read_metadata(folder)
    except (OSError, ValueError):
        about = {}  # the damaged metadata.yaml is written anew
    if about.get("compression_mode"):
        raise BagError(f"bag: {folder}: a compressed bag can be read but not repaired")
    if any(path.suffix != ".mcap" for path in files):
        raise BagError(f"bag: {folder}: expected .mcap files to repair, got {files[0].name}")
    with FolderLock(folder):
        (folder / RESERVE).unlink(missing_ok=True)
        topics: dict[str, BagTopic] = {}
        contents: list[FileContents] = []
        notes: list[str] = []
        for path in files:
            notes += filter(None, [_finish_mcap(path)])
            found, content = contents_of(path)
            topics.update({topic.name: topic for topic in found})
            contents.append(content)
        custom = custom_data(about)
        if notes or not custom:
            custom[REPAIRED] = "; ".join(notes) or "nothing was lost"
        # Files are named in the order in which they were written, which their times tell.
        contents.sort(key=lambda content: (content.first_ns, content.path.name))
        write_metadata(folder, information(topics.values(), contents, custom))
    return Repaired(sum(content.total for content in contents), len(contents), tuple(notes))


def storage_files(folder: Path) -> list[Path]:
    """A bag's storage files. Raises BagError if there are none."""
    if not folder.is_dir():
        raise BagError(f"bag: {folder}: expected a folder, found none")
    found = sorted(path for path in folder.iterdir() if path.suffix in _SUFFIXES and path.is_file())
    if not found:
        raise BagError(f"bag: {folder}: expected .mcap or .db3 files in it, found none")
    return found


def contents_of(path: Path) -> tuple[list[BagTopic], FileContents]:
    """Topics and counts of one finished file. Raises BagError if it cannot be read."""
    reader = McapReader(path)
    try:
        reader.open()
        try:
            topics = [_topic(connection) for connection in reader.connections]
            counts: Counter[str] = Counter()
            for connection in reader.connections:
                counts[connection.topic] += connection.msgcount
            about = reader.metadata
        finally:
            reader.close()
    except Exception as error:  # damaged bytes lead rosbags to errors of many types
        raise damaged(path, error) from error
    content = FileContents(path, dict(counts))
    if about.message_count:
        content.first_ns, content.last_ns = about.start_time, about.end_time - 1
    return topics, content


def _topic(connection: Connection) -> BagTopic:
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    text = connection.msgdef.data
    # rosbags reads no type hash from MCAP files.
    digest = connection.digest or hash_of(connection.msgtype, text)
    qos = tuple(connection.ext.offered_qos_profiles)
    return BagTopic(connection.topic, connection.msgtype, text, digest, qos)


def _finish_mcap(path: Path) -> str:
    """Replace an unfinished or damaged file by a copy of all messages before its first fault.

    The file itself is kept as NAME.original. Returns what was cut off; empty if the file is whole.
    Raises BagFullError, with nothing changed, if there is no space for the copy.
    """
    if _is_whole(path):
        return ""
    copy, kept = path.with_name(f".{path.name}.repairing"), path.with_name(f"{path.name}{KEPT}")
    try:
        count, fault = _copy_messages(path, copy)
        if not kept.exists():
            path.rename(kept)
        copy.replace(path)
    except OSError as error:
        copy.unlink(missing_ok=True)
        raise BagFullError(f"bag: {path}: {error}: a repair needs space for a copy") from error
    return f"{path.name}: cut off after {count} messages ({fault})"


def _is_whole(path: Path) -> bool:
    """Whether a file has an index, and all its records can be read."""
    try:
        contents_of(path)
        with path.open("rb") as file:
            for _ in _records(file, path):
                pass
    except Exception:  # damaged bytes lead parsers and decompressors to errors of many types
        return False
    return True


def _records(file: BinaryIO, path: Path) -> Iterator[McapRecord]:
    size = path.stat().st_size  # a longer record is not one
    reader = StreamReader(file, validate_crcs=True, record_size_limit=size)
    return iter(reader.records)


def _copy_messages(path: Path, copy: Path) -> tuple[int, str]:
    """Write a finished file; return its number of messages, and why it has no more."""
    schemas: dict[int, int] = {}  # their numbers in the copy
    channels: dict[int, int] = {}
    count = 0
    with path.open("rb") as source, copy.open("wb") as target:
        writer = Writer(target, _CHUNK_BYTES, CompressionType.NONE)
        writer.start("ros2", "pa_ros")
        records = _records(source, path)
        fault = "only its index was damaged"
        while True:
            try:
                record = next(records, None)
            except Exception as error:  # as in _is_whole
                fault = f"{type(error).__name__} {error}".strip()
                break
            if record is None:
                break
            if isinstance(record, Schema) and record.id not in schemas:
                schemas[record.id] = writer.register_schema(
                    record.name, record.encoding, record.data
                )
            elif isinstance(record, Channel) and record.id not in channels:
                channels[record.id] = writer.register_channel(
                    record.topic,
                    record.message_encoding,
                    schemas[record.schema_id],
                    record.metadata,
                )
            elif isinstance(record, Message):
                count += 1
                writer.add_message(
                    channels[record.channel_id],
                    record.log_time,
                    record.data,
                    record.publish_time,
                    record.sequence,
                )
        writer.finish()
        target.flush()
        os.fsync(target.fileno())
    return count, fault
