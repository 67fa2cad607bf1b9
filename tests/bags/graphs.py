"""What the tests of recording share: publishing, and reading with mcap-ros2-support alone."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from pa_ros.ros.topics import Topic

DEADLINE_S = 30.0


def decoded(bag: Path) -> list[tuple[str, Any]]:
    """(topic, message) in the order recorded, by an independent implementation."""
    found = []
    for file in sorted(bag.glob("*.mcap")):
        with file.open("rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            found += [(r.channel.topic, r.decoded_message) for r in reader.iter_decoded_messages()]
    return found


def publisher_heard(node, topic: Topic, listeners: int = 1):
    """A publisher that someone listens to."""
    publisher = node.create_publisher(topic.type, topic.name, topic.writer)
    wait_for(lambda: publisher.get_subscription_count() >= listeners, "a listener")
    return publisher


def wait_for(condition: Callable[[], bool], what: str, deadline_s: float = DEADLINE_S) -> None:
    deadline = time.monotonic() + deadline_s
    while not condition():
        assert time.monotonic() < deadline, f"timed out: {what}"
        time.sleep(0.02)


def pa_ros(*arguments: str, domain: str) -> subprocess.Popen:
    """A `pa_ros` command as a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "pa_ros", *map(str, arguments)],
        env={**os.environ, "ROS_DOMAIN_ID": domain, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
