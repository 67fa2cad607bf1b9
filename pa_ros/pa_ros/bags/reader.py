"""Reads a bag: any rosbag2 folder or file. Every problem is one line that says what to do."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import TypeVar

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat, Qos
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from pa_ros.bags.errors import BagError
from pa_ros.bags.format import (
    METADATA,
    VERSION,
    FolderLock,
    custom_data,
    damaged,
    read_metadata,
    repair_command,
)
from pa_ros.bags.repair import storage_files
from pa_ros.core import __version__
from pa_ros.wire import Message
from pa_ros.wire.definitions import hash_of, installed_types

OURS = "msgs_schema/"

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Recorded:
    """One message as it is stored in a bag."""

    topic: str
    type_name: str
    stamp_ns: int  # wall time of recording
    payload: bytes


class Bag:
    """An open bag; a context manager."""

    def __init__(self, path: Path) -> None:
        """Raises BagError if the bag is missing, unfinished, still being recorded, damaged, or
        has messages of another version of pa_ros."""
        self.path = path
        _check_finished(path)
        with ExitStack() as opened:
            try:
                self.custom = custom_data(read_metadata(path))
                self._reader = Reader(path)
                self._reader.open()
                opened.callback(self._reader.close)
                self._connections = _connections(self._reader)
            except Exception as error:  # damaged bytes lead rosbags to errors of many types
                hint = f"; try {repair_command(path)}" if path.is_dir() else ""
                raise damaged(path, f"{error}{hint}") from error
            self._check_version()
            # The bag is whole: from now on its owner closes it.
            opened.pop_all()

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self._reader.close()

    @property
    def types(self) -> dict[str, str]:
        """Type by topic."""
        return {name: entries[0].msgtype for name, entries in self._connections.items()}

    @property
    def counts(self) -> dict[str, int]:
        """Messages by topic."""
        return {
            name: sum(entry.msgcount for entry in entries)
            for name, entries in self._connections.items()
        }

    @property
    def first_ns(self) -> int:
        """Wall time of the earliest message; 0 if there are no messages."""
        return int(self._reader.start_time) if self._reader.message_count else 0

    @property
    def duration_s(self) -> float:
        """Seconds from the earliest message to the latest."""
        return max(0, int(self._reader.duration) - 1) / 1e9

    def qos(self, topic: str) -> list[Qos]:
        """The profiles that the topic's publishers offered."""
        found: list[Qos] = []
        for entry in self._connections[topic]:
            if isinstance(entry.ext, ConnectionExtRosbag2):
                found += [one for one in entry.ext.offered_qos_profiles if one not in found]
        return found

    def topics_of(self, type_name: str, namespace: str | None = None) -> list[str]:
        """The topics of a type, below a namespace if one is given."""
        below = _below(namespace)
        return [n for n, t in self.types.items() if t == type_name and n.startswith(below)]

    def topic_of(self, type_name: str, namespace: str | None = None) -> str:
        """The one topic of a type, below a namespace if one is given.

        Raises BagError (code bag.foreign) if there are none or several.
        """
        found, prefix = self.topics_of(type_name, namespace), _below(namespace)
        # Samples, and what camera_node saw, are in namespaces below that of an arena's own topics.
        own = [name for name in found if "/" not in name.removeprefix(prefix)] or found
        if len(own) == 1:
            return own[0]
        where = f" below {prefix}" if namespace is not None else ""
        got = ", ".join(sorted(found or self.types)) or "no topics"
        hint = ": choose with --namespace" if found else ""
        raise BagError(
            f"bag: {self.path}: expected one topic of type {type_name}{where}, got {got}{hint}",
            code="bag.foreign",
        )

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        stop_ns: int | None = None,
    ) -> Iterator[Recorded]:
        """Yield messages in the order of time, of some topics or all, wall times in [start, stop).

        Raises BagError where the file cannot be read further.
        """
        chosen = [
            entry
            for name, entries in self._connections.items()
            if topics is None or name in topics
            for entry in entries
        ]
        if not chosen:
            return  # rosbags would read all topics
        count = 0
        try:
            for entry, stamp_ns, payload in self._reader.messages(chosen, start_ns, stop_ns):
                yield Recorded(entry.topic, entry.msgtype, stamp_ns, bytes(payload))
                count += 1
        except Exception as error:  # damaged bytes lead rosbags to errors of many types
            raise damaged(self.path, f"unreadable after {count} messages: {error}") from error

    def deserialize(self, recorded: Recorded) -> Message:
        """The message as an object, by the definition in the bag. Raises BagError."""
        try:
            store = self._store(recorded.topic)
            return Message(store.deserialize_cdr(recorded.payload, recorded.type_name))
        except Exception as error:  # a payload or definition that is not what it should be
            raise BagError(
                f"bag: {self.path}: {recorded.topic} at {recorded.stamp_ns} ns: not a "
                f"{recorded.type_name} ({type(error).__name__}: {error})",
                code="bag.damaged",
            ) from error

    def decoded(self, topics: Collection[str], decode: Callable[[Message], T]) -> Iterator[T]:
        """Yield what `decode` makes of each message of some topics, in the order of time."""
        for recorded in self.messages(topics):
            yield decode(self.deserialize(recorded))

    def _store(self, topic: str) -> Typestore:
        """The types of a topic as the bag defines them, or else as installed."""
        entry = self._connections[topic][0]
        if entry.msgdef.format != MessageDefinitionFormat.MSG:
            return _installed()
        # The bag's own, so that it can be read where its types are not installed.
        return _defined(entry.msgdef.data, entry.msgtype)

    def _check_version(self) -> None:
        """Reject messages of pa_ros whose definition is not the installed one."""
        version = self.custom.get(VERSION, "0.1 or a version that is not known")
        for entries in self._connections.values():
            type_name = entries[0].msgtype
            if not type_name.startswith(OURS):
                continue
            found = entries[0].digest or hash_of(type_name, entries[0].msgdef.data)
            known = type_name in _installed().fielddefs
            if not known or found != _installed().hash_rihs01(type_name):
                raise BagError(
                    f"bag: {self.path}: recorded by pa_ros {version}, whose "
                    f"{type_name} is not the one of pa_ros {__version__} here: read it with the "
                    "version that recorded it",
                    code="bag.version",
                )


@cache
def _installed() -> Typestore:
    return installed_types()


@lru_cache(maxsize=128)
def _defined(definition: str, type_name: str) -> Typestore:
    """A type by its definition. Its code is compiled at the first message: 10 ms."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, type_name))
    return store


def _below(namespace: str | None) -> str:
    return "/" if namespace is None else f"/{namespace.strip('/')}/".replace("//", "/")


def _connections(reader: Reader) -> dict[str, list[Connection]]:
    """The connections of each topic as the storage files state them.

    rosbags skips messages whose connection differs from what metadata.yaml says, so its own list is
    used only for topics without messages. Raises ValueError if metadata.yaml counts other messages
    than the files hold.
    """
    stated = reader.connections
    found = {entry.topic: [entry] for entry in stated}
    if isinstance(reader.storage, DirectoryReader):
        held = [entry for storage in reader.storage.storages for entry in storage.connections]
        total = sum(entry.msgcount for entry in held)
        if total != reader.message_count:
            raise ValueError(
                f"{METADATA} counts {reader.message_count} messages, its files hold {total}"
            )
        found |= {entry.topic: [] for entry in held}
        for entry in held:
            found[entry.topic].append(entry)
    return found


def _check_finished(path: Path) -> None:
    if not path.exists():
        raise BagError(f"bag: {path}: expected a bag, found none")
    # Reading a pipe or a device might never end.
    for one in path.iterdir() if path.is_dir() else [path]:
        if not (one.is_file() or one.is_dir()):
            raise damaged(one, "expected a regular file, got a device or a pipe")
    if path.is_dir() and not (path / METADATA).exists():
        storage_files(path)
        FolderLock(path).release()  # raises if the bag is still being written
        raise BagError(
            f"bag: {path}: its recorder was killed before it wrote {METADATA}: "
            f"{repair_command(path)} makes it readable",
            code="bag.unfinished",
        )
