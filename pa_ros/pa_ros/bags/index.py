"""Which topics a bag's files hold, held against what its metadata.yaml says of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader

from pa_ros.bags.errors import ForeignBagError
from pa_ros.wire.definitions import hash_of


def connections_of(reader: Reader) -> dict[str, list[Connection]]:
    """By topic, what an open reader is to read its messages through, in the files' own words: it
    passes over what metadata.yaml says in others, be it of the quality of service alone.

    Raises ForeignBagError if a topic is of several types, ValueError if the files hold other
    messages than metadata.yaml says, and whatever comes of names, counts and times of other kinds.
    """
    stated = reader.connections
    _check_kinds(reader)
    found: dict[str, list[Connection]] = {}
    if isinstance(reader.storage, DirectoryReader):
        held = [entry for storage in reader.storage.storages for entry in storage.connections]
        _compare(stated, held, reader.message_count)
        found = {entry.topic: [entry] for entry in stated}  # those without messages, too
    else:
        held = stated
    found |= {entry.topic: [] for entry in held}
    for entry in held:
        found[entry.topic].append(entry)
    for topic, entries in found.items():
        _check_type(topic, entries)
    return found


def messages_by_topic(entries: Iterable[Connection]) -> Counter[str]:
    """Messages of each topic, of which a file may have several entries."""
    found: Counter[str] = Counter()
    for entry in entries:
        found[entry.topic] += entry.msgcount
    return found


def _check_kinds(reader: Reader) -> None:
    """Raise whatever comes of names, counts and times that are of other kinds: rosbags takes them
    as they stand in metadata.yaml."""
    int(reader.start_time), int(reader.duration)
    for entry in reader.connections:
        found = entry.topic, entry.msgtype, entry.msgcount
        if [*map(type, found)] != [str, str, int]:
            raise ValueError(f"expected a topic's name, type and count, got {found}")


def _compare(stated: Sequence[Connection], held: Sequence[Connection], total: int) -> None:
    """ValueError if metadata.yaml says other topics, types, counts or another total than files."""
    index, files = _messages_by_type(stated), _messages_by_type(held)
    if index != files:
        differing = sorted(dict(index.items() ^ files.items()))
        raise ValueError(
            f"its index says {_said(index, differing)}; its files hold {_said(files, differing)}"
        )
    if total != sum(files.values()):
        raise ValueError(f"its index says {total} messages; its files hold {sum(files.values())}")


def _messages_by_type(entries: Iterable[Connection]) -> dict[tuple[str, str], int]:
    """Messages by topic and type, where there are any."""
    found: Counter[tuple[str, str]] = Counter()
    for entry in entries:
        found[entry.topic, entry.msgtype] += entry.msgcount
    return {key: count for key, count in found.items() if count}


def _said(counts: dict[tuple[str, str], int], keys: Iterable[tuple[str, str]]) -> str:
    return ", ".join(f"{counts.get(key, 0)} of {key[0]} ({key[1]})" for key in keys)


def _check_type(topic: str, entries: Sequence[Connection]) -> None:
    """ForeignBagError if a topic's messages are of several types, or editions of one."""
    types = sorted({entry.msgtype for entry in entries})
    texts = {entry.msgdef.data for entry in entries}
    if len(types) == 1 and len(texts) > 1:
        types = sorted({f"{types[0]} {hash_of(types[0], text)}" for text in texts})
    if len(types) > 1:
        raise ForeignBagError(f"{topic}: expected messages of one type, got {', '.join(types)}")
