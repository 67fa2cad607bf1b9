"""Repairs a bag whose recorder was killed: finishes its files and writes metadata.yaml."""

from __future__ import annotations

import os
import sqlite3
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import breakup_chunk
from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from pa_ros.bags.errors import BagError, BagFullError
from pa_ros.bags.format import (
    REPAIRED,
    RESERVE,
    UNREADABLE,
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

_READERS: dict[str, Any] = {".mcap": McapReader, ".db3": Sqlite3Reader}
_STORAGES = {".mcap": "mcap", ".db3": "sqlite3"}
_MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # of an MCAP record: opcode, length
_CHUNK_BYTES = 1 << 20
KEPT = ".original"  # suffix of a file as it was before a repair


@dataclass(frozen=True)
class Repaired:
    """What a repair found."""

    messages: int
    files: int
    notes: tuple[str, ...]  # what was cut off or left out, file by file


def repair(folder: Path) -> Repaired:
    """Make a bag readable. A bag that needs no repair keeps its files.

    Raises BagError if there is nothing to repair, or while the bag is being recorded.
    """
    files = storage_files(folder)
    with FolderLock(folder):
        return _repair(folder, files)


def _repair(folder: Path, files: list[Path]) -> Repaired:
    (folder / RESERVE).unlink(missing_ok=True)
    topics: dict[str, BagTopic] = {}
    contents: list[FileContents] = []
    cut, unreadable = [], []
    for path in files:
        try:
            if path.suffix == ".mcap":
                end, parts = _finish_mcap(path)
                cut += end
                unreadable += parts
            else:
                _check_sqlite(path)
            found, content = contents_of(path)
        except BagFullError:
            raise
        except BagError as error:
            unreadable.append(f"{path.name} was left out: {error}")
            continue
        topics.update({topic.name: topic for topic in found})
        contents.append(content)
    if not contents:
        raise damaged(folder, f"no file in it can be read: {'; '.join(unreadable)}")
    try:
        custom = custom_data(folder)
    except BagError:
        custom = {}  # the damaged metadata.yaml is written anew
    if cut or unreadable or not custom:
        custom[REPAIRED] = "; ".join(cut + unreadable) or "nothing was lost"
    if unreadable:
        custom[UNREADABLE] = "; ".join(unreadable)
    # Files are named in the order in which they were written, which their times tell.
    contents.sort(key=lambda content: (content.first_ns, content.path.name))
    storage = _STORAGES[contents[0].path.suffix]
    write_metadata(folder, information(storage, topics.values(), contents, custom))
    total = sum(content.total for content in contents)
    return Repaired(total, len(contents), (*cut, *unreadable))


def storage_files(folder: Path) -> list[Path]:
    """Return a bag's storage files. Raises BagError if there are none, or they are compressed."""
    if not folder.is_dir():
        raise BagError(f"bag: {folder}: expected a folder, found none")
    try:
        mode = str(read_metadata(folder).get("compression_mode", "")).lower()
    except BagError:
        mode = ""
    if mode not in ("", "none") or [*folder.glob("*.zst*")]:
        raise BagError(f"bag: {folder}: a compressed bag can be read but not repaired")
    found = sorted(path for path in folder.iterdir() if path.suffix in _READERS)
    if not found:
        raise BagError(f"bag: {folder}: expected .mcap or .db3 files in it, found none")
    return found


def contents_of(path: Path) -> tuple[list[BagTopic], FileContents]:
    """Return topics and counts of one finished file. Raises BagError if it cannot be read."""
    reader = _READERS[path.suffix](path)
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


def _check_sqlite(path: Path) -> None:
    """Return to the last commit, which SQLite does when it opens a file; raise BagError if damaged.

    rosbags cannot do this, because it opens files for reading only.
    """
    try:
        with closing(sqlite3.connect(path)) as connection:
            verdict = connection.execute("PRAGMA quick_check").fetchone()[0]
    except sqlite3.Error as error:
        raise damaged(path, error) from error
    if verdict != "ok":
        raise damaged(path, verdict)


class _McapMessages:
    """The messages of an MCAP file that can be read, whatever its end and its index are like.

    MCAP is a sequence of records, so everything before the first incomplete record can be kept.
    A chunk with a wrong checksum is left out.
    """

    def __init__(self, path: Path) -> None:
        self.damaged_chunks = self.orphans = self.dropped_bytes = 0
        self.finished = False  # the file has its end
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self._path = path

    def read(self) -> Iterator[Message]:
        """Yield the messages in the order of the file; count what cannot be read."""
        with self._path.open("rb") as file:
            for opcode, content in self._records(file):
                for record in self._parts(opcode, content):
                    if isinstance(record, Schema):
                        self.schemas[record.id] = record
                    elif isinstance(record, Channel):
                        self.channels[record.id] = record
                    elif isinstance(record, Message) and record.channel_id in self.channels:
                        yield record
                    elif isinstance(record, Message):  # the chunk that declares it is damaged
                        self.orphans += 1

    def _records(self, file: BinaryIO) -> Iterator[tuple[int, bytes]]:
        """Yield opcode and content of each complete record before the end of the data."""
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        if file.read(len(_MAGIC)) != _MAGIC:
            raise damaged(self._path, "expected an MCAP file, got other content")
        end = file.tell()
        while len(head := file.read(_HEAD.size)) == _HEAD.size:
            opcode, length = _HEAD.unpack(head)
            if file.tell() + length > size:
                break
            content = file.read(length)
            if opcode == Opcode.DATA_END:
                file.seek(-len(_MAGIC), os.SEEK_END)
                self.finished = file.read() == _MAGIC
                break
            yield opcode, content
            end = file.tell()
        self.dropped_bytes = 0 if self.finished else size - end

    def _parts(self, opcode: int, content: bytes) -> list[Any]:
        stream = ReadDataStream(BytesIO(content))
        try:
            if opcode == Opcode.CHUNK:
                return list(breakup_chunk(Chunk.read(stream), validate_crc=True))
            if opcode == Opcode.SCHEMA:
                return [Schema.read(stream)]
            if opcode == Opcode.CHANNEL:
                return [Channel.read(stream)]
            if opcode == Opcode.MESSAGE:
                return [Message.read(stream, len(content))]
        except Exception:  # damaged bytes lead parsers and decompressors to errors of many types
            self.damaged_chunks += 1
        return []


def _finish_mcap(path: Path) -> tuple[list[str], list[str]]:
    """Replace an unfinished or damaged file by a copy of its readable messages.

    The file itself is kept as NAME.original. Returns what was cut off and what was left out.
    Raises BagFullError, with nothing changed, if there is no space for the copy.
    """
    found = _McapMessages(path)
    for _ in found.read():
        pass
    cut, unreadable = [], []
    if found.dropped_bytes:
        cut.append(f"{path.name}: the last {found.dropped_bytes} bytes were incomplete")
    if found.damaged_chunks:
        unreadable.append(f"{path.name}: {found.damaged_chunks} damaged chunks were left out")
    if found.orphans:
        unreadable.append(f"{path.name}: {found.orphans} messages of unknown topics were left out")
    if found.finished and not unreadable:
        try:
            contents_of(path)
            return [], []
        except BagError:
            pass  # its index is damaged: the copy gets a new one
    copy, kept = path.with_name(f".{path.name}.repairing"), path.with_name(f"{path.name}{KEPT}")
    try:
        _copy_messages(_McapMessages(path), found, copy)
        if not kept.exists():
            path.rename(kept)
        copy.replace(path)
    except OSError as error:
        copy.unlink(missing_ok=True)
        raise BagFullError(f"bag: {path}: {error}: a repair needs space for a copy") from error
    return cut, unreadable


def _copy_messages(source: _McapMessages, known: _McapMessages, copy: Path) -> None:
    """Write messages into a new file; its topics are those that a first reading found."""
    with copy.open("wb") as file:
        writer = Writer(file, _CHUNK_BYTES, CompressionType.NONE)
        writer.start("ros2", "pa_ros")
        channels = {}
        for channel in known.channels.values():
            schema = known.schemas[channel.schema_id]
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.id] = writer.register_channel(
                channel.topic, channel.message_encoding, number, channel.metadata
            )
        for one in source.read():
            writer.add_message(
                channels[one.channel_id], one.log_time, one.data, one.publish_time, one.sequence
            )
        writer.finish()
        file.flush()
        os.fsync(file.fileno())
