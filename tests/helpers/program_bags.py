"""Bags of program requests, written as a recording would."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pa_ros.bags.contents import reliable_qos, topic
from pa_ros.bags.reader import Bag
from pa_ros.bags.writer import BagOptions, BagWriter
from pa_ros.wire import codec
from pa_ros.wire.definitions import installed_types, to_cdr
from pa_ros.wire.records import ProgramRequest

STORE = installed_types()
TOPIC = topic(STORE, "/program", "msgs_schema/msg/Program", [reliable_qos(1, latched=True)])
START = 1_700_000_000_000_000_000


def payload(i: int, size: int = 10) -> bytes:
    return to_cdr(STORE, codec.encode_program(ProgramRequest(str(i), "X" * size)))


def written(
    folder: Path, count: int, size: int = 10, close: bool = True, **options: Any
) -> BagWriter:
    """A bag of `count` programs, one a second; left as a SIGKILL would, if not closed."""
    bag = BagWriter(folder, BagOptions(**options))
    bag.add(TOPIC)
    for i in range(count):
        bag.write("/program", payload(i, size), START + i * 10**9, START + i * 10**9 - 5, i + 1)
        bag.flush()
    if close:
        bag.close({"pa_ros.test": "yes"})
    return bag


def identifiers(path: Path) -> list[int]:
    with Bag(path) as bag:
        programs = [codec.decode_program(bag.deserialize(recorded)) for recorded in bag.messages()]
    return [int(program.program_id) for program in programs]


def storage_file(folder: Path) -> Path:
    (file,) = [path for path in folder.iterdir() if path.suffix in (".mcap", ".db3")]
    return file
