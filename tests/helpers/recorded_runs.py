"""Small recorded runs, and bags that differ from them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pa_ros.bags.contents import topic
from pa_ros.bags.reader import Bag
from pa_ros.bags.writer import BagWriter
from pa_ros.cli.main import main
from pa_ros.wire.definitions import installed_types

SMALL = ["learner.replay.warmup_frames=20", "learner.replay.batch_size=8", "network.hidden=16"]


def train(out: Path, *arguments: str | Path, frames: int = 500) -> int:
    """`pa_ros train` of small networks."""
    options = [f"--set={option}" for option in SMALL]
    fixed = ["--seed", "5", "--eval-every", "0", "--frames", str(frames)]
    return main(["train", "--out", str(out), *fixed, *options, *map(str, arguments)])


def rewritten(bag: Path, copy: Path, change: Callable[[str, Any], list[Any]]) -> Path:
    """A bag whose messages went through `change(topic, message)`, which gives those to keep."""
    store = installed_types()
    with Bag(bag) as source, BagWriter(copy) as target:
        for name, type_name in source.types.items():
            target.add(topic(store, name, type_name, source.qos(name)))
        for recorded in source.messages():
            for message in change(recorded.topic, source.deserialize(recorded)):
                payload = bytes(store.serialize_cdr(message, recorded.type_name))
                target.write(recorded.topic, payload, recorded.stamp_ns)
    return copy
