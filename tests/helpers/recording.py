"""What the tests of recording share: publishing, and reading with mcap-ros2-support alone."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.ros.topics import Topic


def decoded(bag: Path) -> list[tuple[str, Any]]:
    """(topic, message) in the order recorded, by an independent implementation."""
    found = []
    for file in sorted(bag.glob("*.mcap")):
        with file.open("rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            found += [(r.channel.topic, r.decoded_message) for r in reader.iter_decoded_messages()]
    return found


def publisher_heard(node: Any, topic: Topic, listeners: int = 1) -> Any:
    """A publisher that someone listens to."""
    publisher = node.create_publisher(topic.type, topic.name, topic.writer)
    wait_for(lambda: publisher.get_subscription_count() >= listeners, "a listener")
    return publisher


def pa_ros(*arguments: str | Path) -> subprocess.Popen[str]:
    """A `pa_ros` command as a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "pa_ros", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def launched(folder: Path, nodes: dict[str, Any], size: int, *words: str) -> tuple[Path, str]:
    """The bag of a graph that was launched in a folder as a person does, and interrupted when the
    bag had so many bytes; and what was printed. `nodes`: their parameters."""
    params = folder / "params.yaml"
    params.write_text(yaml.safe_dump({k: {"ros__parameters": v} for k, v in nodes.items()}))
    folders = ("--out", folder / "run", "--record", folder / "bag")
    with pa_ros("launch", "--params", params, *words, *folders) as process:
        try:
            storage = folder / "bag" / "bag.mcap"
            wait_for(lambda: storage.exists() and storage.stat().st_size > size, "recording")
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=DEADLINE_S)
        finally:
            process.kill()
    assert process.returncode == 0, err
    return folder / "bag", out
