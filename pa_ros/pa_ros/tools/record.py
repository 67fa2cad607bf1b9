"""Records topics into a rosbag2 bag.

Messages are never deserialized: their bytes go to the file with the time at which the middleware
received them and their publisher's own time and number. A thread of the recorder takes them every
DRAIN_S from subscriptions that no executor serves, so recording does not depend on what else the
process does.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, Final

from pydantic import Field
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosReliability

from pa_ros.bags.errors import BagError, BagFullError
from pa_ros.bags.format import BEFORE, LOST, reliable_qos, topic
from pa_ros.bags.writer import BagOptions, BagWriter
from pa_ros.core.clock import now_ns
from pa_ros.core.errors import ConfigError
from pa_ros.ros import topics
from pa_ros.ros.environment import check_namespace
from pa_ros.ros.executor import node_beside, spin_until, take_messages
from pa_ros.ros.topics import Topic
from pa_ros.tools.graph import DISCOVERY_S
from pa_ros.wire.definitions import installed_types, message_class, message_type, register

log = logging.getLogger(__name__)

# Everything: what was requested, observed, done and scored, and what was learned from it.
BAG_TOPICS = (
    topics.PROVENANCE,
    topics.ARENA_INFO,
    topics.LEARNER_INFO,
    topics.PROGRAM,
    topics.PROGRAM_STATUS,
    topics.OBJECT_FEATURES,
    topics.JOINT_STATES,
    topics.JOINT_COMMANDS,
    topics.TRAJECTORIES,
    topics.POLICY_WEIGHTS,
    topics.CLOCK,
    topics.DIAGNOSTICS,
)
OF_LEARNER = (topics.LEARNER_INFO, topics.TRAJECTORIES, topics.POLICY_WEIGHTS)
DRAIN_S: Final = 0.005
FLUSH_S: Final = 1.0  # at most so much is lost by a SIGKILL
_ROUND: Final = 500  # messages taken from one topic before the next has its turn


class RecordingOptions(BagOptions):
    """Content and storage of a recording."""

    topics: tuple[str, ...] = Field((), description="by name; none: all of pa_ros")
    namespace: str = Field("", description="of the arena to record")
    arenas: tuple[str, ...] = Field(
        (), description="of a fleet: namespaces of its arenas, below that of its learner"
    )
    duration_s: float = Field(0.0, ge=0, description="seconds; then stop; 0: until stopped")


class Recorder:
    """Writes every message of some topics; a context manager that closes the bag.

    `counts`, `lost` and `failure` may be read at any time. A full disk closes the bag and sets
    `failure`, as does any other error in the recorder's thread. Nothing is recorded afterwards.
    """

    def __init__(
        self,
        folder: Path,
        node: Node,
        recorded: Iterable[Topic] = BAG_TOPICS,
        options: BagOptions | None = None,
    ) -> None:
        """Names are resolved in the node's namespace, and each is recorded once.

        Raises BagError, or ConfigError for a name that ROS rejects.
        """
        self.failure: BagError | None = None
        self._node = node
        self._recorded = {_resolved(node, one.name): one for one in recorded}
        self._types = installed_types()
        for one in self._recorded.values():
            register(self._types, message_type(one.type))
        self._writer = BagWriter(folder, options)
        self._readers: list[_TopicReader] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)

    def __enter__(self) -> Recorder:
        # Its own node: no executor may take the messages before the recorder's thread does.
        self._reader = node_beside(self._node, "recorder")
        try:
            for name, one in self._recorded.items():
                type_name = message_type(one.type)
                self._writer.add(topic(self._types, name, type_name, [offered_qos(one.writer)]))
                self._readers.append(_TopicReader(self._reader, name, one))
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
        """Messages that were published but not received, by the topic's full name."""
        return {reader.name: reader.gaps.lost for reader in self._readers}

    @property
    def size_mb(self) -> float:
        """Megabytes on disk."""
        return self._writer.size / 1e6

    def rows(self) -> list[tuple[str, str]]:
        """(topic, messages and losses) for a live table, and the size."""
        lost = self.lost
        rows = [(name, f"{n:>9}  lost {lost.get(name, 0)}") for name, n in self.counts.items()]
        return [*rows, ("size", f"{self.size_mb:.1f} MB")]

    def line(self) -> str:
        """The same in one line."""
        messages, lost = sum(self.counts.values()), sum(self.lost.values())
        return f"{messages} messages  {self.size_mb:.1f} MB  lost {lost}"

    def close(self) -> None:
        """Record what has arrived, then write the index and metadata."""
        if self._stop.is_set():
            return
        self._stop.set()
        self._thread.join()
        before = {reader.name: reader.gaps.before for reader in self._readers}
        counted = {LOST: json.dumps(self.lost), BEFORE: json.dumps(before)}
        try:
            self._writer.close(counted)
        except BagFullError as error:
            self.failure = error
        self._reader.destroy_node()

    def _run(self) -> None:
        flushed = time.monotonic()
        try:
            while not self._stop.wait(DRAIN_S):
                self._drain()
                if time.monotonic() - flushed >= FLUSH_S:
                    flushed = time.monotonic()
                    self._writer.flush()
                    for reader in self._readers:
                        reader.hear_all()
            while self._drain():
                pass
        except BagFullError as error:
            self.failure = error
        except Exception as error:  # `failure` is the only way to report it from this thread
            log.exception("the recorder's thread ended")
            self.failure = BagError(f"record: recording ended: {type(error).__name__}: {error}")

    def _drain(self) -> int:
        """Record up to _ROUND waiting messages of each topic; return how many there were."""
        taken, began_ns = 0, now_ns()
        to_steady_ns = began_ns - time.time_ns()
        for reader in self._readers:
            before = taken
            for payload, info in reader.take():
                sent_ns, number = info["source_timestamp"], info["publication_sequence_number"]
                # Some middlewares do not say when a message arrived.
                log_ns = (info["received_timestamp"] or time.time_ns()) + to_steady_ns
                # The wall clock may have been set since it arrived.
                log_ns = min(max(log_ns, reader.emptied_ns), now_ns())
                self._writer.write(reader.name, payload, log_ns, sent_ns, number or 0)
                taken += 1
            if taken - before < _ROUND:
                reader.emptied_ns = began_ns
        return taken


class _TopicReader:
    """The recorder's subscription to one topic."""

    def __init__(self, node: Node, name: str, one: Topic) -> None:
        self.name = name
        self.emptied_ns = now_ns()  # what waits now arrived later
        self.gaps = SequenceGaps(lambda: node.count_publishers(name))
        self._node, self._topic = node, one
        self._reliable_sensor = isinstance(one, topics.SensorTopic)
        self._subscribe(one.reader)

    def _subscribe(self, profile: QoSProfile) -> None:
        kind, qos = self._topic.type, reader_qos(profile)
        create = self._node.create_subscription
        self._subscription = create(kind, self.name, lambda _: None, qos, raw=True)

    def hear_all(self) -> None:
        """Read with best effort as soon as a driver publishes so, as `SensorTopic` does."""
        found = self._node.get_publishers_info_by_topic(self.name) if self._reliable_sensor else ()
        if any(one.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT for one in found):
            self._reliable_sensor = False
            self._node.destroy_subscription(self._subscription)
            self._subscribe(topics.best_effort(self._topic.reader))

    def take(self) -> Iterable[tuple[bytes, Any]]:
        """Yield waiting messages, with what the middleware says about each."""
        for payload, info in islice(take_messages(self._subscription, raw=True), _ROUND):
            if number := info["publication_sequence_number"] or 0:
                self.gaps.take(number)
            yield payload, info


class SequenceGaps:
    """Counts missing messages from the numbers 1, 2, 3, … that publishers give them.

    A message does not say which publisher it is from. With several publishers, each number is
    assigned so that the fewest messages are missing.
    """

    PUBLISHERS = 16  # of one topic whose sequences are followed at a time

    def __init__(self, publishers: Callable[[], int] = lambda: 1) -> None:
        """`publishers` returns how many there are now; it is called only when numbers are
        ambiguous."""
        self.lost = 0
        self.before = 0  # published before the first message that was received
        self._publishers = publishers
        self._expected: list[int] = []  # next number of each publisher, the latest received last

    def take(self, number: int) -> None:
        """Count a message that was received."""
        earlier = [expected for expected in self._expected if expected < number]
        if number in self._expected:
            self._expected.remove(number)
        elif number == 1 or not earlier or self._publishers() > len(self._expected):
            self.before += number - 1  # the first message of another publisher
        else:
            self.lost += number - max(earlier)
            self._expected.remove(max(earlier))
        self._expected = [*self._expected[-self.PUBLISHERS + 1 :], number + 1]


def reader_qos(profile: QoSProfile) -> QoSProfile:
    """A reader's profile with a longer queue, so that the recorder loses nothing.

    The queue is unlimited, except for latched topics: their messages are few, or as large as
    weights, so a hundred are enough.
    """
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    reliable = profile.reliability == ReliabilityPolicy.RELIABLE
    depth = max(profile.depth, topics.LATCHED_READER.depth)
    return topics.quality(depth, latched, reliable, keep_all=not latched)


def offered_qos(profile: QoSProfile) -> Qos:
    """A publisher's profile in rosbag2's form, so that it can be played back."""
    return reliable_qos(profile.depth)._replace(
        history=QosHistory[profile.history.name],
        reliability=QosReliability[profile.reliability.name],
        durability=QosDurability[profile.durability.name],
    )


def topics_of(arenas: Sequence[str]) -> tuple[Topic, ...]:
    """All topics of pa_ros, of one arena or of a fleet's.

    Raises ConfigError for a namespace that ROS rejects.
    """
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
    """Topics by name: ours, and any other that has a publisher now.

    Raises BagError for one without a publisher, ConfigError for a name that ROS rejects.
    """
    ours = {_resolved(node, one.name): one for one in topics_of(arenas)}
    wanted = [_resolved(node, name) for name in names]
    others = [name for name in wanted if name not in ours]

    def unpublished() -> list[str]:
        return [name for name in others if not node.get_publishers_info_by_topic(name)]

    # Our own topics have known types; those of others are known from their publishers only.
    spin_until(node, lambda: not unpublished(), DISCOVERY_S if others else 0.0)
    if unpublished():
        known = ", ".join(sorted(name.rpartition("/")[2] for name in ours))
        raise BagError(f"record: nobody publishes {unpublished()}; topics of pa_ros are {known}")
    return [ours.get(name) or _other_topic(node, name) for name in wanted]


def _resolved(node: Node, name: str) -> str:
    try:
        return str(node.resolve_topic_name(name))
    except RuntimeError as error:  # rcl's own
        raise ConfigError(f"record: {name!r:.200} is not the name of a topic: {error}") from error


def _other_topic(node: Node, name: str) -> Topic:
    """A topic that is not ours, with a profile that matches all its publishers."""
    found = node.get_publishers_info_by_topic(name)
    profiles = [info.qos_profile for info in found]
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
    latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
    profile = topics.quality(topics.STEP.depth, latched, reliable)
    return Topic(name, message_class(found[0].topic_type), profile, profile)
