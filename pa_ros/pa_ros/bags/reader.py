"""Reading a bag: any rosbag2 folder or file; whatever is wrong with it is said in one line."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat, Qos
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from pa_ros.bags.claim import Claim
from pa_ros.bags.contents import METADATA, repair_command, stated
from pa_ros.bags.errors import (
    BagError,
    DamagedBagError,
    DefinitionError,
    ForeignBagError,
    UnfinishedBagError,
)
from pa_ros.bags.index import connections_of
from pa_ros.bags.repair import custom_data, storage_files
from pa_ros.wire import Message
from pa_ros.wire.arena import WIRE_VERSION
from pa_ros.wire.definitions import installed_types

OF_EDITION_1 = "msgs_schema/msg/Transitions"  # Trajectory since

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Recorded:
    """One message as it lies in a bag."""

    topic: str
    type_name: str
    stamp_ns: int  # wall time of recording
    payload: bytes


class Bag:
    """An open bag; a context manager."""

    def __init__(self, path: Path) -> None:
        """Raises BagError if there is no whole bag: UnfinishedBagError, DamagedBagError …"""
        self.path = path
        _check_there(path)
        _check_inside(path)
        with ExitStack() as opened:
            try:
                self._reader = Reader(path)
                self._reader.open()
                opened.callback(self._reader.close)
                self._connections = connections_of(self._reader)
            except ForeignBagError as error:
                raise ForeignBagError(f"bag: {path}: {error}") from error
            except Exception as error:  # rosbags' own, and those of whatever the bytes lead it to
                hint = f"; try {repair_command(path)}" if path.is_dir() else ""
                raise DamagedBagError(f"bag: {path}: {error}{hint}") from error
            opened.pop_all()
        self._stores: dict[str, Typestore] = {}

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
        """Messages by topic, as the bag's index says."""
        return {
            name: sum(entry.msgcount for entry in entries)
            for name, entries in self._connections.items()
        }

    @property
    def first_ns(self) -> int:
        """Wall time of the earliest message; 0 if there is none."""
        return int(self._reader.start_time) if self._reader.message_count else 0

    @property
    def duration_s(self) -> float:
        """From the earliest message to the latest, s."""
        return max(0, int(self._reader.duration) - 1) / 1e9

    @property
    def custom(self) -> dict[str, str]:
        """custom_data of metadata.yaml."""
        return custom_data(self.path)

    @property
    def unseen(self) -> str:
        """What a repair had to pass over within the bag; empty: nothing."""
        notes = self.custom.get("pa_ros.repaired", "").split("; ")
        return "; ".join(note for note in notes if "damaged" in note or "left out" in note)

    def qos(self, topic: str) -> list[Qos]:
        """Profiles that the topic's publishers offered."""
        found: list[Qos] = []
        for entry in self._connections[topic]:
            if isinstance(entry.ext, ConnectionExtRosbag2):
                found += [one for one in entry.ext.offered_qos_profiles if one not in found]
        return found

    def definition(self, topic: str) -> str:
        """Text of the topic's message definition; empty if the bag has none."""
        return str(self._connections[topic][0].msgdef.data)

    def check_edition(self) -> None:
        """Raises ForeignBagError for a recording of version 0.1."""
        if OF_EDITION_1 in self.types.values():
            raise ForeignBagError(
                f"bag: {self.path}: expected messages of edition {WIRE_VERSION}, got edition 1, "
                "which version 0.1 records and reads"
            )

    def topics_of(self, type_name: str, namespace: str | None = None) -> list[str]:
        """The topics of a type, below a namespace if one is given."""
        below = _below(namespace)
        return [n for n, t in self.types.items() if t == type_name and n.startswith(below)]

    def topic_of(self, type_name: str, namespace: str | None = None) -> str:
        """The one topic of a type, below a namespace if one is given.

        Raises ForeignBagError if there is none, or several.
        """
        found, prefix = self.topics_of(type_name, namespace), _below(namespace)
        if len(found) == 1:
            return found[0]
        where = f" below {prefix}" if namespace is not None else ""
        if found:
            raise ForeignBagError(
                f"bag: {self.path}: expected one topic of type {type_name}{where}, got "
                f"{', '.join(sorted(found))}: choose with --namespace"
            )
        self.check_edition()
        raise ForeignBagError(
            f"bag: {self.path}: expected a topic of type {type_name}{where}, got "
            f"{', '.join(sorted(self.types)) or 'no topics'}"
        )

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        stop_ns: int | None = None,
    ) -> Iterator[Recorded]:
        """Messages in the order of time, of some topics or all, wall times in [start, stop).

        Raises DamagedBagError where the file cannot be read further.
        """
        chosen = [
            entry
            for name, entries in self._connections.items()
            if topics is None or name in topics
            for entry in entries
        ]
        if not chosen:
            return
        count = 0
        try:
            for entry, stamp_ns, payload in self._reader.messages(chosen, start_ns, stop_ns):
                yield Recorded(entry.topic, entry.msgtype, stamp_ns, bytes(payload))
                count += 1
        except Exception as error:  # as above
            raise DamagedBagError(
                f"bag: {self.path}: unreadable after {count} messages: {error}; "
                f"{repair_command(self.path)} makes the rest readable"
            ) from error

    def deserialize(self, recorded: Recorded) -> Message:
        """The message as an object, by the definition in the bag. Raises DefinitionError."""
        store = self._store(recorded.topic)
        try:
            return Message(store.deserialize_cdr(recorded.payload, recorded.type_name))
        except Exception as error:  # a payload that is not what its definition says
            raise DefinitionError(
                f"bag: {self.path}: {recorded.topic} at {recorded.stamp_ns} ns: not a "
                f"{recorded.type_name} ({type(error).__name__}: {error})"
            ) from error

    def through(self, recorded: Recorded, read: Callable[[Message], T]) -> T:
        """What `read` makes of the message. DefinitionError if it lacks a field that `read` needs;
        raises whatever else `read` does."""
        try:
            return read(self.deserialize(recorded))
        except AttributeError as error:
            raise DefinitionError(
                f"bag: {self.path}: {recorded.topic}: another edition of {recorded.type_name} "
                f"than this software's: {error}"
            ) from error

    def differs(self, topic: str) -> bool:
        """Whether a topic was recorded with another edition of its definition than is installed."""
        type_name = self._connections[topic][0].msgtype
        installed = installed_types()
        if type_name not in installed.fielddefs:
            return False
        recorded = self._store(topic)
        return bool(recorded.hash_rihs01(type_name) != installed.hash_rihs01(type_name))

    def _store(self, topic: str) -> Typestore:
        if topic not in self._stores:
            self._stores[topic] = _store_of(self._connections[topic][0])
        return self._stores[topic]


def _below(namespace: str | None) -> str:
    return "/" if namespace is None else f"/{namespace.strip('/')}/".replace("//", "/")


def _store_of(entry: Connection) -> Typestore:
    """The types of a topic as the bag defines them; as installed where it does not."""
    if entry.msgdef.format != MessageDefinitionFormat.MSG:
        return installed_types()
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(entry.msgdef.data, entry.msgtype))
    except Exception as error:
        raise DefinitionError(f"bag: {entry.topic}: definition of {entry.msgtype}: {error}") from (
            error
        )
    return store


def _check_inside(path: Path) -> None:
    """DamagedBagError if metadata.yaml is no YAML, names a file that is not in the bag's own
    folder, or has no list of files: rosbags opens such a bag, and can't close it."""
    about = stated(path)
    names, files = about.get("relative_file_paths"), about.get("files", [])
    if not isinstance(names, list):
        return  # a single file, or one that rosbags refuses
    if not isinstance(files, list):
        raise DamagedBagError(f"bag: {path}: {METADATA}: files: expected a list, got {files!r}")
    for name in map(str, names):
        if Path(name).name != name:
            raise DamagedBagError(
                f"bag: {path}: {METADATA}: expected files of this folder, got {name!r}"
            )


def _check_there(path: Path) -> None:
    if not path.exists():
        raise BagError(f"bag: {path}: expected a bag, found none")
    if path.is_dir() and not (path / METADATA).exists():
        files = storage_files(path)
        Claim(path).release()  # nobody writes it
        raise UnfinishedBagError(
            f"bag: {path}: {len(files)} file(s) but no {METADATA}: its recorder was killed; "
            f"{repair_command(path)} makes it readable"
        )
