"""Recording topics into a rosbag2 bag (MCAP) from raw subscriptions.

`python -m pa_ros.ros.record FOLDER` records BAG_TOPICS until SIGINT or SIGTERM. Messages are never
deserialized: their bytes go to the file as they came, in chunks of a megabyte, so memory stays
bounded whatever the length of the recording.
"""

from __future__ import annotations

import argparse
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from pa_ros.core.errors import PaError
from pa_ros.ros import topics
from pa_ros.ros.topics import Topic

# All of an execution: what was asked, seen, done and judged.
BAG_TOPICS = (
    topics.ARENA_INFO,
    topics.PROGRAM,
    topics.PROGRAM_STATUS,
    topics.OBJECT_FEATURES,
    topics.JOINT_STATES,
    topics.JOINT_COMMANDS,
    topics.VERDICT,
    topics.CLOCK,
    topics.DIAGNOSTICS,
)
_FOREVER = QosTime(9223372036, 854775807)  # how rosbag2 writes an unlimited duration
BAG_VERSION: Final = 9  # of rosbag2's metadata, as Jazzy writes it


class BagError(PaError):
    """A bag that cannot be written, or a message type whose definition is not installed."""

    code = "bag"


class Recorder:
    """Writes every message of some topics, as bytes, with the time at which it arrived.

    A context manager: on leaving it, whatever the cause, index and metadata are written, so that
    the bag is readable.
    """

    def __init__(self, folder: Path, node: Node, recorded: Iterable[Topic] = BAG_TOPICS) -> None:
        """Names are resolved in the node's namespace. Raises BagError if `folder` exists."""
        self._node = node
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        try:
            self._writer = Writer(folder, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
        except WriterError as error:
            raise BagError(f"bag: {error}") from error
        self._recorded = tuple(recorded)
        self._subscriptions: list[Any] = []
        self.counts: dict[str, int] = {}  # by the topic's full name

    def __enter__(self) -> Recorder:
        try:
            self._writer.open()
        except (WriterError, OSError) as error:
            raise BagError(f"bag: {error}") from error
        try:
            for topic in self._recorded:
                self._subscribe(topic)
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop recording and write the index. Nothing is written afterwards."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()
        self._writer.close()

    def _subscribe(self, topic: Topic) -> None:
        name, type_name = self._node.resolve_topic_name(topic.name), message_type(topic.type)
        register(self._typestore, type_name)
        connection = self._writer.add_connection(
            name,
            type_name,
            typestore=self._typestore,
            offered_qos_profiles=[offered_qos(topic.writer)],
        )
        self.counts[name] = 0
        self._subscriptions.append(
            self._node.create_subscription(
                topic.type, topic.name, self._keep(connection), topic.reader, raw=True
            )
        )

    def _keep(self, connection: Connection) -> Callable[[bytes], None]:
        def receive(payload: bytes) -> None:
            self._writer.write(connection, time.time_ns(), payload)
            self.counts[connection.topic] += 1

        return receive


def message_type(message_class: Any) -> str:
    """Full name of a message class: "sensor_msgs/msg/JointState"."""
    package, kind = message_class.__module__.split(".")[:2]
    return f"{package}/{kind}/{message_class.__name__}"


def register(typestore: Typestore, type_name: str) -> None:
    """Make a type known, from the .msg files that its package installs. Raises BagError."""
    if type_name in typestore.fielddefs:
        return
    package = type_name.partition("/")[0]
    try:
        folder = Path(get_package_share_directory(package)) / "msg"
    except PackageNotFoundError as error:
        raise BagError(f"bag: {type_name}: {error}") from error
    for file in sorted(folder.glob("*.msg")):
        typestore.register(get_types_from_msg(file.read_text(), f"{package}/msg/{file.stem}"))
    if type_name not in typestore.fielddefs:
        raise BagError(f"bag: {type_name}: expected its definition in {folder}, found none")


def offered_qos(profile: QoSProfile) -> Qos:
    """A publisher's profile as rosbag2's metadata states it, so that it can be played back."""
    return Qos(
        history=QosHistory[profile.history.name],
        depth=profile.depth,
        reliability=QosReliability[profile.reliability.name],
        durability=QosDurability[profile.durability.name],
        deadline=_FOREVER,
        lifespan=_FOREVER,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_FOREVER,
        avoid_ros_namespace_conventions=False,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Record until SIGINT or SIGTERM; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m pa_ros.ros.record", description=__doc__)
    parser.add_argument("folder", type=Path, help="the bag to write; must not exist")
    parser.add_argument("--namespace", default="", help="of the arena to record")
    options = parser.parse_args(arguments)
    try:
        _record(options.folder, options.namespace)
    except PaError as error:
        print(f"record: {error}", file=sys.stderr)
        return 2
    return 0


def _record(folder: Path, namespace: str) -> None:
    from pa_ros.ros.client import client_node
    from pa_ros.ros.executor import spin

    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with client_node("recorder", namespace) as node, Recorder(folder, node) as recorder:
        print(f"recording into {folder}", flush=True)
        spin(node, stop)
        print(f"{sum(recorder.counts.values())} messages", flush=True)


if __name__ == "__main__":
    sys.exit(main())
