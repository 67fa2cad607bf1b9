"""Recording topics into a rosbag2 bag from raw subscriptions.

Messages are never deserialized: their bytes go to the file as they came, with the time at which
the middleware received them and their publisher's own time and number. A thread of the recorder's
own takes them, in turns of DRAIN_S, from readers that no executor serves, so that recording costs
the same whatever else the process does.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import rclpy
from pydantic import Field
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability

from pa_ros.bags.contents import FOREVER, topic
from pa_ros.bags.errors import BagError, BagFullError
from pa_ros.bags.losses import LOST, Losses
from pa_ros.bags.writer import BagOptions, BagWriter
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.provenance.metadata import as_custom_data
from pa_ros.ros import topics
from pa_ros.ros.executor import spin_until
from pa_ros.ros.names import check_namespace
from pa_ros.ros.topics import Topic
from pa_ros.tools.graph import DISCOVERY_S
from pa_ros.wire.arena import decode_arena_info
from pa_ros.wire.definitions import installed_types, message_class, message_type, register
from pa_ros.wire.diagnostics import decode_provenance

log = logging.getLogger(__name__)

# Everything: what was asked, seen, done and judged, and what was learned from it.
BAG_TOPICS = (
    topics.PROVENANCE,
    topics.ARENA_INFO,
    topics.LEARNER_INFO,
    topics.PROGRAM,
    topics.PROGRAM_STATUS,
    topics.OBJECT_FEATURES,
    topics.JOINT_STATES,
    topics.JOINT_COMMANDS,
    topics.VERDICT,
    topics.TRAJECTORIES,
    topics.POLICY_WEIGHTS,
    topics.CLOCK,
    topics.DIAGNOSTICS,
)
OF_LEARNER = (topics.LEARNER_INFO, topics.TRAJECTORIES, topics.POLICY_WEIGHTS)
DRAIN_S: Final = 0.005
FLUSH_S: Final = 1.0  # what a SIGKILL can cost
_TURN: Final = 500  # messages of one topic per turn, so that none starves


class RecordingOptions(BagOptions):
    """What to record, into what."""

    topics: tuple[str, ...] = Field((), description="by name; none: all of pa_ros")
    namespace: str = Field("", description="of the arena to record")
    arenas: tuple[str, ...] = Field(
        (), description="of a fleet: namespaces of its arenas, below that of its learner"
    )
    duration_s: float = Field(0.0, ge=0, description="seconds; then stop; 0: until stopped")


class Recorder:
    """Writes every message of some topics; a context manager that closes the bag.

    `counts`, `lost` and `failure` may be read at any time. A full disk closes the bag and sets
    `failure`, as does whatever else ends its thread; nothing is recorded afterwards.
    """

    def __init__(
        self,
        folder: Path,
        node: Node,
        recorded: Iterable[Topic] = BAG_TOPICS,
        options: BagOptions | None = None,
    ) -> None:
        """Names are resolved in the node's namespace, and each is recorded once. Raises BagError,
        or ConfigError for a name that ROS refuses."""
        self.failure: BagError | None = None
        self._node = node
        self._recorded = {_resolved(node, one.name): one for one in recorded}
        self._types = installed_types()
        for one in self._recorded.values():
            register(self._types, message_type(one.type))
        self._writer = BagWriter(folder, options)
        self._lines: list[_Line] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)

    def __enter__(self) -> Recorder:
        name = f"{self._node.get_name()}_recorder"
        self._reader = rclpy.create_node(
            name,
            namespace=self._node.get_namespace(),
            context=self._node.context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        try:
            for full, one in self._recorded.items():
                self._lines.append(self._line(full, one))
        except BaseException:
            self._writer.close()
            self._reader.destroy_node()
            raise
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def counts(self) -> dict[str, int]:
        """Messages recorded, by the topic's full name."""
        return dict(self._writer.counts)

    @property
    def lost(self) -> dict[str, int]:
        """Messages that were sent and did not come, by the topic's full name."""
        return {line.name: line.losses.lost for line in self._lines}

    @property
    def size(self) -> int:
        """Bytes on disk."""
        return self._writer.size

    def close(self) -> None:
        """Take what has come, write the index and metadata. Nothing is written afterwards."""
        if self._stop.is_set():
            return
        self._stop.set()
        self._thread.join()
        try:
            self._writer.close({LOST: json.dumps(self.lost), **self._provenance()})
        except BagFullError as error:
            self.failure = error
        self._reader.destroy_node()

    def _line(self, name: str, one: Topic) -> _Line:
        type_name = message_type(one.type)
        self._writer.add(topic(self._types, name, type_name, [offered_qos(one.writer)]))
        return _Line(self._reader, name, one)

    def _run(self) -> None:
        flushed = time.monotonic()
        try:
            while not self._stop.wait(DRAIN_S):
                self._drain()
                if time.monotonic() - flushed >= FLUSH_S:
                    flushed = time.monotonic()
                    self._writer.flush()
            while self._drain():
                pass
        except BagFullError as error:
            self.failure = error
        except Exception as error:  # of whatever kind: nobody else hears of it
            log.exception("the recorder's thread has ended")
            self.failure = BagError(f"record: recording ended: {type(error).__name__}: {error}")

    def _drain(self) -> int:
        """One turn: what has come on each topic; how much it was."""
        taken = 0
        for line in self._lines:
            for payload, info in line.take():
                sent_ns, number = info["source_timestamp"], info["publication_sequence_number"]
                log_ns = info["received_timestamp"] or time.time_ns()
                self._writer.write(line.name, payload, log_ns, sent_ns, number or 0)
                taken += 1
        return taken

    def _provenance(self) -> dict[str, str]:
        """What the latched topics said, decoded for the metadata."""
        origins, arenas = [], []
        for line in self._lines:
            for payload in line.said:
                message = self._types.deserialize_cdr(payload, line.type_name)
                try:
                    if line.type_name.endswith("/Provenance"):
                        origins.append(decode_provenance(message))
                    else:
                        arenas.append(decode_arena_info(message))
                except PaError:
                    continue  # of another edition; the message itself is in the bag
        return as_custom_data(origins, arenas)


class _Line:
    """One topic on its way into the bag."""

    def __init__(self, node: Node, name: str, one: Topic) -> None:
        self.name = name
        self.type_name = message_type(one.type)
        self.losses = Losses(lambda: node.count_publishers(name))
        self.said: deque[bytes] = deque(maxlen=100)  # what goes into the metadata too
        self._keeps = one.type in (topics.PROVENANCE.type, topics.ARENA_INFO.type)
        self._subscription = node.create_subscription(
            one.type, name, lambda _: None, reader_qos(one.reader), raw=True
        )

    def take(self) -> Iterable[tuple[bytes, Any]]:
        """Messages that have come, with what the middleware says of each."""
        subscription = self._subscription
        for _ in range(_TURN):
            with subscription.handle:
                taken = subscription.handle.take_message(subscription.msg_type, True)
            if taken is None:
                break
            payload, info = taken
            if number := info["publication_sequence_number"] or 0:
                self.losses.take(number)
            if self._keeps:
                self.said.append(payload)
            yield payload, info


def reader_qos(profile: QoSProfile) -> QoSProfile:
    """The same, but with room for what may wait: the recorder is to lose nothing.

    Without limit where messages are small or must not be lost; a hundred of the latched ones,
    which are few, or as large as weights.
    """
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return QoSProfile(
        reliability=profile.reliability,
        durability=profile.durability,
        history=HistoryPolicy.KEEP_LAST if latched else HistoryPolicy.KEEP_ALL,
        depth=max(profile.depth, topics.LATCHED_READER.depth),
    )


def offered_qos(profile: QoSProfile) -> Qos:
    """A publisher's profile as rosbag2's metadata states it, so that it can be played back."""
    return Qos(
        history=QosHistory[profile.history.name],
        depth=profile.depth,
        reliability=QosReliability[profile.reliability.name],
        durability=QosDurability[profile.durability.name],
        deadline=FOREVER,
        lifespan=FOREVER,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=FOREVER,
        avoid_ros_namespace_conventions=False,
    )


def topics_of(arenas: Sequence[str]) -> tuple[Topic, ...]:
    """All of pa_ros, of one arena or of a fleet's. ConfigError for a namespace that ROS refuses."""
    for arena in arenas:
        check_namespace(arena, "arenas")
    within = [
        one.within(arena)
        for arena in arenas
        for one in BAG_TOPICS
        if one not in OF_LEARNER and not one.name.startswith("/")
    ]
    return (*BAG_TOPICS, *within)


def topics_named(node: Node, names: Iterable[str], arenas: Sequence[str] = ()) -> list[Topic]:
    """Topics by name: ours, and any other that someone publishes now. Raises BagError, or
    ConfigError for a name that ROS refuses."""
    ours = {_resolved(node, one.name): one for one in topics_of(arenas)}
    wanted = [_resolved(node, name) for name in names]
    strangers = [name for name in wanted if name not in ours]

    def unseen() -> list[str]:
        return [name for name in strangers if not node.get_publishers_info_by_topic(name)]

    spin_until(node, lambda: not unseen(), DISCOVERY_S if strangers else 0.0)
    if unseen():
        known = ", ".join(sorted(name.rpartition("/")[2] for name in ours))
        raise BagError(
            f"record: expected topics that someone publishes, or {known}; got {unseen()}"
        )
    return [ours.get(name) or _stranger(node, name) for name in wanted]


def _resolved(node: Node, name: str) -> str:
    try:
        return str(node.resolve_topic_name(name))
    except RuntimeError as error:  # rcl's own
        raise ConfigError(f"record: expected a name of a topic, got {name!r:.200}: {error}") from (
            error
        )


def _stranger(node: Node, name: str) -> Topic:
    found = node.get_publishers_info_by_topic(name)
    profiles = [info.qos_profile for info in found]
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
    latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
    profile = QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        history=HistoryPolicy.KEEP_LAST,
        depth=topics.STEP.depth,
    )
    return Topic(name, message_class(found[0].topic_type), profile, profile)
