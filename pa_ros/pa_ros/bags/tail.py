"""Finishing an MCAP file whose writer was killed or ran out of space, beside the one that is there.

MCAP is a sequence of records, so everything up to the last complete one can be kept. What is
missing (the index of the last chunk, the summary, the end) is computed from the chunks, which are
read one at a time. A chunk that fails its checksum stays where it is, but is not named in the
summary, so that readers pass it over; what topics are, which the first chunk tells, is taken from
it all the same, or from the file's own summary.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    MessageIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import get_chunk_data_stream

from pa_ros.bags.errors import BagFullError, DamagedBagError
from pa_ros.wire.definitions import hash_of, installed_definition

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<HIQ")  # channel, sequence, log time
_NEVER = 2**63 - 1
KEPT = ".original"  # suffix of a file as it was before a repair


@dataclass
class _Scan:
    """What the complete part of a file holds."""

    end: int = 0  # of the last complete record
    whole: bool = False  # nothing is missing
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=lambda: defaultdict(int))
    chunks: list[ChunkIndex] = field(default_factory=list)
    last_index: dict[int, list[tuple[int, int]]] = field(default_factory=dict)  # of the last chunk
    damaged: int = 0  # chunks that cannot be read
    metadata: int = 0
    first_ns: int = _NEVER
    last_ns: int = 0


@dataclass(frozen=True)
class Finished:
    """What was done to a file."""

    dropped_bytes: int  # at its end, of no use
    damaged_chunks: int  # passed over
    changed: bool  # False: it was whole


def finish(path: Path) -> Finished:
    """Make a file whole. Raises DamagedBagError if it is not MCAP at all."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        scan = _scan(path, file, size)
        if scan.whole and not scan.damaged:
            return Finished(0, 0, False)
        _write_beside(path, file, scan)
    dropped = 0 if scan.whole else size - scan.end
    return Finished(dropped, scan.damaged, True)


def _write_beside(path: Path, file: BinaryIO, scan: _Scan) -> None:
    """Put a finished copy in the file's place, and keep the file. BagFullError if there is no room;
    then nothing has changed."""
    copy, kept = path.with_name(f".{path.name}.repairing"), path.with_name(f"{path.name}{KEPT}")
    try:
        with copy.open("wb") as target:
            file.seek(0)
            left = scan.end
            while left:
                left -= target.write(file.read(min(left, 1 << 20)))
            target.write(_ending(scan))
            target.flush()
            os.fsync(target.fileno())
        if not kept.exists():
            path.rename(kept)
        copy.replace(path)
    except OSError as error:
        copy.unlink(missing_ok=True)
        raise BagFullError(f"bag: {path}: {error}: a repair needs room for a copy") from error


def _scan(path: Path, file: BinaryIO, size: int) -> _Scan:
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        raise DamagedBagError(f"bag: {path}: expected an MCAP file, got other content")
    scan = _Scan(end=len(MAGIC))
    while True:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return scan
        opcode, length = _HEAD.unpack(head)
        following = scan.end + _HEAD.size + length
        if following > size or opcode == Opcode.DATA_END:
            file.seek(-len(MAGIC), os.SEEK_END)
            scan.whole = opcode == Opcode.DATA_END and file.read(len(MAGIC)) == MAGIC
            if scan.whole and scan.damaged:
                _read_summary(scan, file, following)
            return scan
        content = b"" if opcode == Opcode.ATTACHMENT else file.read(length)
        try:
            _take(scan, opcode, content)
        except Exception:  # whatever a decompressor or a parser says of damaged bytes
            scan.damaged += 1
            scan.last_index = {}
            if opcode == Opcode.CHUNK:
                _take_definitions(scan, content)
        file.seek(following)
        scan.end = following


def _read_summary(scan: _Scan, file: BinaryIO, start: int) -> None:
    """What topics are, from a summary that begins at `start`."""
    file.seek(start)
    while len(head := file.read(_HEAD.size)) == _HEAD.size:
        opcode, length = _HEAD.unpack(head)
        if opcode == Opcode.FOOTER:
            return
        content = file.read(length)
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            _take_inner(scan, opcode, memoryview(content))


def _take_definitions(scan: _Scan, content: bytes) -> None:
    """What topics are, from a chunk that fails its checksum; what stands there wrongly is found by
    its hash."""
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(content)))
        for _, opcode, inner in _records(memoryview(chunk.data if not chunk.compression else b"")):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                _take_inner(scan, opcode, inner)
    except Exception:  # as far as it can be read
        pass
    for channel in scan.channels.values():
        schema = scan.schemas.get(channel.schema_id)
        digest = channel.metadata.get("topic_type_hash", "")
        if (
            schema is not None
            and digest
            and hash_of(schema.name, schema.data.decode(errors="replace")) != digest
        ):
            schema.data = installed_definition(schema.name, digest).encode() or schema.data


def _take(scan: _Scan, opcode: int, content: bytes) -> None:
    if opcode == Opcode.CHUNK:
        _take_chunk(scan, content)
    elif opcode == Opcode.MESSAGE_INDEX and scan.last_index:
        channel = int.from_bytes(content[:2], "little")
        scan.chunks[-1].message_index_offsets[channel] = scan.end
        scan.chunks[-1].message_index_length += _HEAD.size + len(content)
        scan.last_index.pop(channel, None)
    elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
        _take_inner(scan, opcode, memoryview(content))
    elif opcode == Opcode.METADATA:
        scan.metadata += 1


def _take_chunk(scan: _Scan, content: bytes) -> None:
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    found = list(_records(memoryview(stream.read(length))))
    scan.chunks.append(
        ChunkIndex(
            chunk_length=_HEAD.size + len(content),
            chunk_start_offset=scan.end,
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            message_end_time=chunk.message_end_time,
            message_index_length=0,
            message_index_offsets={},
            message_start_time=chunk.message_start_time,
            uncompressed_size=chunk.uncompressed_size,
        )
    )
    scan.last_index = {}
    for offset, opcode, inner in found:
        message = _take_inner(scan, opcode, inner)
        if message is not None:
            channel, log_ns = message
            scan.last_index.setdefault(channel, []).append((log_ns, offset))


def _records(chunk: memoryview) -> Iterator[tuple[int, int, memoryview]]:
    offset = 0
    while offset < len(chunk):
        opcode, length = _HEAD.unpack_from(chunk, offset)
        start = offset + _HEAD.size
        yield offset, opcode, chunk[start : start + length]
        offset = start + length


def _take_inner(scan: _Scan, opcode: int, content: memoryview) -> tuple[int, int] | None:
    """Take in a record that a chunk may contain; channel and time of a message."""
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(ReadDataStream(BytesIO(content)))
        scan.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(ReadDataStream(BytesIO(content)))
        scan.channels[channel.id] = channel
    elif opcode == Opcode.MESSAGE:
        number, _, log_ns = _MESSAGE.unpack_from(content)
        scan.counts[number] += 1
        scan.first_ns, scan.last_ns = min(scan.first_ns, log_ns), max(scan.last_ns, log_ns)
        return number, log_ns
    return None


def _ending(scan: _Scan) -> bytes:
    """Everything after the last complete record."""
    builder = RecordBuilder()
    for channel, entries in scan.last_index.items():
        chunk = scan.chunks[-1]
        chunk.message_index_offsets[channel] = scan.end + builder.count
        before = builder.count
        MessageIndex(channel, entries).write(builder)
        chunk.message_index_length += builder.count - before
    DataEnd(0).write(builder)
    data = builder.end()
    start = scan.end + len(data)
    summary, offsets_at = _summary(scan, start)
    footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_at)
    crc = zlib.crc32(footer, zlib.crc32(summary))
    Footer(summary_offset_start=offsets_at, summary_crc=crc, summary_start=start).write(builder)
    return bytes(data) + summary + bytes(builder.end()) + MAGIC


def _summary(scan: _Scan, start: int) -> tuple[bytes, int]:
    """The summary section and where its offsets begin."""
    builder, offsets = RecordBuilder(), []
    statistics = Statistics(
        attachment_count=0,
        channel_count=len(scan.channels),
        channel_message_counts=dict(scan.counts),
        chunk_count=len(scan.chunks),
        message_count=sum(scan.counts.values()),
        message_end_time=scan.last_ns,
        message_start_time=scan.first_ns if scan.counts else 0,
        metadata_count=scan.metadata,
        schema_count=len(scan.schemas),
    )
    groups = (
        (Opcode.SCHEMA, list(scan.schemas.values())),
        (Opcode.CHANNEL, list(scan.channels.values())),
        (Opcode.STATISTICS, [statistics]),
        (Opcode.CHUNK_INDEX, scan.chunks),
    )
    for opcode, records in groups:
        first = builder.count
        for record in records:
            record.write(builder)
        if records:
            offsets.append(SummaryOffset(opcode, start + first, builder.count - first))
    offsets_at = start + builder.count
    for offset in offsets:
        offset.write(builder)
    return bytes(builder.end()), offsets_at
