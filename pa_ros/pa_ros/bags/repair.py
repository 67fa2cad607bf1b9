"""Making a bag whole whose recorder was killed: its files are finished beside what was there."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from pa_ros.bags.claim import Claim
from pa_ros.bags.contents import (
    RESERVE,
    BagTopic,
    FileContents,
    information,
    stated,
    write_metadata,
)
from pa_ros.bags.errors import BagError, DamagedBagError
from pa_ros.bags.index import messages_by_topic
from pa_ros.bags.storage import STORAGES
from pa_ros.bags.tail import finish
from pa_ros.wire.definitions import hash_of

_READERS: dict[str, Any] = {".mcap": McapReader, ".db3": Sqlite3Reader}


@dataclass(frozen=True)
class Repaired:
    """What a repair found and did."""

    messages: int
    files: int
    notes: tuple[str, ...]  # what could not be kept, file by file


def repair(folder: Path) -> Repaired:
    """Make the bag readable; harmless on a whole one.

    Raises BagError if there is nothing, BagInUseError while it is being recorded.
    """
    files = storage_files(folder)
    with Claim(folder):
        return _repair(folder, files)


def _repair(folder: Path, files: list[Path]) -> Repaired:
    (folder / RESERVE).unlink(missing_ok=True)
    topics: dict[str, BagTopic] = {}
    contents, notes = [], []
    for path in files:
        try:
            notes += [f"{path.name}: {note}" for note in _FINISH[path.suffix](path)]
            found, content = contents_of(path)
        except BagError as error:
            notes.append(f"{path.name}: left out: {error}")
            continue
        topics.update({topic.name: topic for topic in found})
        contents.append(content)
    if not contents:
        raise DamagedBagError(f"bag: {folder}: nothing in it can be read: {'; '.join(notes)}")
    name = next(name for name, kind in STORAGES.items() if kind.suffix == files[0].suffix)
    custom = custom_data(folder)
    if notes or not custom:
        custom["pa_ros.repaired"] = "; ".join(notes) or "no byte was lost"
    about = information(name, topics.values(), contents, custom)
    write_metadata(folder, about | _of_messages(folder))
    return Repaired(sum(content.total for content in contents), len(contents), tuple(notes))


def _of_messages(folder: Path) -> dict[str, str]:
    """What metadata.yaml says of compressed messages, which files don't."""
    try:
        about = stated(folder)
    except DamagedBagError:
        return {}
    found = {key: str(about.get(key)) for key in ("compression_mode", "compression_format")}
    return found if found["compression_mode"].lower() == "message" else {}


def storage_files(folder: Path) -> list[Path]:
    """A bag's storage files in the order they were written. Raises BagError if there are none."""
    if not folder.is_dir():
        raise BagError(f"bag: {folder}: expected a folder, found none")
    found = [path for path in folder.iterdir() if path.suffix in _READERS]
    packed = sorted(path.name for path in folder.iterdir() if path.suffix in (".zstd", ".zst"))
    if packed:
        raise BagError(
            f"bag: {folder}: expected plain .mcap or .db3 files, got {', '.join(packed)}: unpack "
            "them (unzstd) first"
        )
    if not found:
        raise BagError(f"bag: {folder}: expected .mcap or .db3 files in it, found none")
    stems = {path.stem for path in found}
    return sorted(found, key=lambda path: (_number(path, stems), path.name))


def contents_of(path: Path) -> tuple[list[BagTopic], FileContents]:
    """Topics and counts of one whole file. Raises DamagedBagError."""
    reader = _READERS[path.suffix](path)
    try:
        reader.open()
        try:
            topics = [_topic(connection) for connection in reader.connections]
            counts = messages_by_topic(reader.connections)
            about = reader.metadata
        finally:
            reader.close()
    except Exception as error:  # rosbags' own, and those of whatever the bytes lead it to
        raise DamagedBagError(f"bag: {path}: {error}") from error
    content = FileContents(path, counts)
    if about.message_count:
        content.first_ns, content.last_ns = about.start_time, about.end_time - 1
    return topics, content


def custom_data(folder: Path) -> dict[str, str]:
    """custom_data of the metadata.yaml that is there, if one is."""
    try:
        custom = stated(folder).get("custom_data")
    except DamagedBagError:
        return {}
    if not isinstance(custom, dict):
        return {}
    return {str(key): str(value) for key, value in custom.items()}


def _number(path: Path, stems: Collection[str]) -> int:
    """0, 1, 2, … of `bag.mcap`, `bag_1.mcap`, `bag_2.mcap`, … and, as stock recorders call them, of
    `bag_0.mcap`, `bag_1.mcap`, …; `bag` itself may end in a number."""
    name, _, number = path.stem.rpartition("_")
    of_others = any(re.fullmatch(rf"{re.escape(path.stem)}_\d+", stem) for stem in stems)
    if not re.fullmatch(r"\d+", number) or (of_others and name not in stems):
        return 0
    return int(number)


def _topic(connection: Connection) -> BagTopic:
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    return BagTopic(
        connection.topic,
        connection.msgtype,
        connection.msgdef.data,
        connection.digest or _digest(connection),
        tuple(connection.ext.offered_qos_profiles),
    )


def _digest(connection: Connection) -> str:
    """The type hash, computed where rosbags reads none (MCAP)."""
    return hash_of(connection.msgtype, connection.msgdef.data)


def _finish_mcap(path: Path) -> list[str]:
    done = finish(path)
    notes = []
    if done.damaged_chunks:
        notes.append(f"{done.damaged_chunks} damaged chunks were passed over")
    if done.dropped_bytes:
        notes.append(f"the last {done.dropped_bytes} bytes were incomplete and were cut off")
    return notes


def _finish_sqlite(path: Path) -> list[str]:
    """SQLite itself goes back to the last commit; what remains is to check."""
    try:
        with sqlite3.connect(path) as connection:
            verdict = connection.execute("PRAGMA quick_check").fetchone()[0]
        connection.close()
    except sqlite3.Error as error:
        raise DamagedBagError(f"bag: {path}: {error}") from error
    return [] if verdict == "ok" else [str(verdict)]


_FINISH: dict[str, Callable[[Path], list[str]]] = {
    ".mcap": _finish_mcap,
    ".db3": _finish_sqlite,
}
