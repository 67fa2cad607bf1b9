"""Plays a bag into a live graph: with the recorded timing, or as fast as it is received."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Final

from pydantic import Field
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from pa_ros.bags.errors import BagError
from pa_ros.bags.reader import Bag, Recorded
from pa_ros.core.settings import Settings
from pa_ros.ros import topics
from pa_ros.ros.executor import take_messages
from pa_ros.tools.graph import DISCOVERY_S
from pa_ros.wire import WireError
from pa_ros.wire.definitions import message_class, message_type
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.step import encode_clock, step_answered

WINDOW: Final = 20  # messages of a topic that may be unacknowledged when playing at rate 0
ACK_S: Final = 5.0  # time-out for acknowledgements, and for an arena to reach a step
ARENA_S: Final = 0.5  # in which an arena's topics are discovered
CLOCK_PERIOD_S: Final = 0.01
_SPIN_S: Final = 0.0005  # busy-wait so long before a message is due: sleeping is not that exact
_NAP_S: Final = 0.0002


class PlaybackOptions(Settings):
    """Which part of a bag is played, and how fast."""

    SECTION: ClassVar[str] = "playback"

    rate: float = Field(
        1.0, ge=0, description="times the recorded speed; 0: as fast as it is received"
    )
    topics: tuple[str, ...] = Field((), description="full names, or their last parts; none: all")
    start_s: float = Field(0.0, ge=0, description="seconds after the bag's first message")
    duration_s: float = Field(0.0, ge=0, description="seconds of recorded time; 0: to the end")
    loop: bool = Field(False, description="repeat until stopped")
    clock: bool = Field(False, description="publish /clock with the recorded times")
    wait_s: float = Field(
        DISCOVERY_S,
        ge=0,
        description="seconds, at most, to wait for a subscriber of each topic",
    )


@dataclass
class Played:
    """Counts of published messages."""

    counts: dict[str, int] = field(default_factory=dict)  # messages by topic
    late_s: deque[float] = field(default_factory=lambda: deque(maxlen=100_000))  # behind schedule
    left_out: dict[str, str] = field(default_factory=dict)  # topics that cannot be played, and why
    without_subscriber: list[str] = field(default_factory=list)  # topics, at the start


class Player:
    """Publishes the recorded bytes with the quality of service stated in the bag.

    If an arena is running, a joint command waits until the arena reaches the step that the command
    answers. In lockstep, from the same seed, the arena then moves exactly as recorded.
    """

    def __init__(self, bag: Bag, node: Node, options: PlaybackOptions | None = None) -> None:
        """Raises BagError if the bag has none of the topics."""
        self.played = Played()
        self._bag, self._node = bag, node
        self._options = options or PlaybackOptions()
        self._publishers: dict[str, Any] = {}
        self._unacknowledged: dict[str, int] = {}
        for name in self._chosen():
            self._advertise(name)
        if not self._publishers:
            raise BagError(f"bag: {bag.path}: nothing to play: {self.played.left_out}")
        self._clock = topics.ROS_CLOCK.publisher(node) if self._options.clock else None
        self._waits = {
            name: _StepWait(node, name)
            for name in self._publishers
            if bag.types[name] == message_type(topics.JOINT_COMMANDS.type)
        }

    def run(self, stopped: Callable[[], bool] = lambda: False) -> Played:
        """Play to the end, or until `stopped`. Raises BagError."""
        if 0.0 < self._options.start_s >= self._bag.duration_s:
            raise BagError(
                f"playback: --start: expected less than the bag's {self._bag.duration_s:g} s, "
                f"got {self._options.start_s:g}"
            )
        self._wait_for_subscribers(stopped)
        for wait in self._waits.values():
            wait.find_arena(set(self._publishers))
        first_ns = self._bag.first_ns + int(self._options.start_s * 1e9)
        self._publish_latched(first_ns)
        self._play_once(first_ns, stopped)
        while self._options.loop and not stopped():
            self._play_once(first_ns, stopped)
        for name in self._publishers:
            self._wait_for_acknowledgement(name)
        return self.played

    def _chosen(self) -> list[str]:
        there, wanted = self._bag.types, self._options.topics
        if not wanted:
            replaced = topics.ROS_CLOCK.name if self._options.clock else ""
            return [name for name in there if name != replaced]
        found = []
        for one in wanted:
            named = [one] if one.startswith("/") else [n for n in there if n.endswith(f"/{one}")]
            named = [name for name in named if name in there]
            if not named:
                raise BagError(
                    f"bag: {self._bag.path}: expected one of {', '.join(sorted(there))}, got {one}"
                )
            found += named
        return list(dict.fromkeys(found))

    def _advertise(self, name: str) -> None:
        type_name = self._bag.types[name]
        try:
            kind = message_class(type_name)
        except WireError:
            self.played.left_out[name] = f"{type_name} is not installed here"
            return
        profile = _profile(self._bag, name, keep_all=self._options.rate == 0.0)
        self._publishers[name] = self._node.create_publisher(kind, name, profile)
        self._unacknowledged[name] = self.played.counts[name] = 0

    def _wait_for_subscribers(self, stopped: Callable[[], bool]) -> None:
        # A publisher is discovered some time after it was made, and what it publishes before is
        # lost.
        deadline = time.monotonic() + self._options.wait_s
        waiting = list(self._publishers)
        while waiting and time.monotonic() < deadline and not stopped():
            time.sleep(0.02)
            waiting = [n for n in waiting if not self._publishers[n].get_subscription_count()]
        self.played.without_subscriber = waiting

    def _publish_latched(self, first_ns: int) -> None:
        """Publish the latched messages that a subscriber at `first_ns` would have received."""
        if self._options.start_s == 0.0:
            return
        latched: dict[str, deque[Recorded]] = {}
        for name in self._publishers:
            profile = _profile(self._bag, name)
            if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
                latched[name] = deque(maxlen=profile.depth)
        for recorded in self._bag.messages(latched, stop_ns=first_ns) if latched else ():
            latched[recorded.topic].append(recorded)
        for kept in latched.values():
            for recorded in kept:
                self._publish(recorded)

    def _play_once(self, first_ns: int, stopped: Callable[[], bool]) -> None:
        stop_ns, started = None, time.perf_counter()
        if self._options.duration_s:
            stop_ns = first_ns + int(self._options.duration_s * 1e9)
        for recorded in self._bag.messages(self._publishers, first_ns, stop_ns):
            if self._options.rate:
                due = started + (recorded.stamp_ns - first_ns) / 1e9 / self._options.rate
                self._sleep_until(due, recorded.stamp_ns, stopped)
                self.played.late_s.append(time.perf_counter() - due)
            if stopped():
                return
            self._publish_clock(recorded.stamp_ns)
            if wait := self._waits.get(recorded.topic):
                wait.until(step_answered(self._bag.deserialize(recorded)), stopped)
            self._publish(recorded)

    def _sleep_until(self, due: float, stamp_ns: int, stopped: Callable[[], bool]) -> None:
        while (left := due - time.perf_counter()) > 0:
            if left > CLOCK_PERIOD_S:
                if stopped():
                    return
                self._publish_clock(stamp_ns - int(left * self._options.rate * 1e9))
            if left > _SPIN_S:
                time.sleep(min(left - _SPIN_S, CLOCK_PERIOD_S))

    def _publish_clock(self, stamp_ns: int) -> None:
        if self._clock is not None:
            self._clock.publish(encode_clock(stamp_ns))

    def _publish(self, recorded: Recorded) -> None:
        name = recorded.topic
        self._publishers[name].publish(recorded.payload)
        self.played.counts[name] += 1
        self._unacknowledged[name] += 1
        if self._options.rate == 0.0 and self._unacknowledged[name] >= WINDOW:
            self._wait_for_acknowledgement(name)

    def _wait_for_acknowledgement(self, name: str) -> None:
        """Wait until every reliable subscriber has what was published."""
        self._unacknowledged[name] = 0
        publisher = self._publishers[name]
        if publisher.get_subscription_count() == 0:
            return
        if not publisher.wait_for_all_acked(Duration(seconds=ACK_S)):
            raise BagError(
                f"playback: {name}: subscribers did not acknowledge within {ACK_S:g} s",
                code="playback",
            )


class _StepWait:
    """Holds a command back until the arena reaches the step that the command answers."""

    def __init__(self, node: Node, commands: str) -> None:
        self._node = node
        self._name = f"{commands.rpartition('/')[0]}/{topics.OBJECT_FEATURES.name}"
        # No executor serves this subscription: `_newest` takes its messages itself, without a
        # callback, so that waiting for a step costs little.
        self._subscription = replace(topics.OBJECT_FEATURES, name=self._name).subscribe(node, id)
        self._reached_ns = -1  # stamp of the arena's newest step
        self._active = False

    def find_arena(self, played_here: set[str]) -> None:
        """Look whether there is an arena to wait for, unless its steps are played as well."""
        deadline = time.monotonic() + ARENA_S
        while not self._active and self._name not in played_here and time.monotonic() < deadline:
            time.sleep(0.02)
            self._active = self._node.count_publishers(self._name) > 0

    def until(self, stamp_ns: int, stopped: Callable[[], bool]) -> None:
        """Wait for the step. Raises BagError if the arena does not reach it."""
        deadline = time.monotonic() + ACK_S
        while self._active and self._newest() < stamp_ns and not stopped():
            if time.monotonic() > deadline:
                raise BagError(
                    f"playback: the next command is for the step of stamp {stamp_ns} ns, but the "
                    f"arena stays at {self._reached_ns} ns: use the recorded seed and design",
                    code="playback",
                )
            time.sleep(_NAP_S)

    def _newest(self) -> int:
        for message, _ in take_messages(self._subscription):
            self._reached_ns = max(self._reached_ns, header_stamp(message))
        return self._reached_ns


def _profile(bag: Bag, name: str, keep_all: bool = False) -> QoSProfile:
    """The profile that a topic's publishers offered; the weakest of several."""
    offered = bag.qos(name)
    if not offered:
        return topics.STEP
    reliable = all(one.reliability.name != "BEST_EFFORT" for one in offered)
    latched = all(one.durability.name == "TRANSIENT_LOCAL" for one in offered)
    every = keep_all or any(one.history.name == "KEEP_ALL" for one in offered)
    depth = max([1, *(one.depth for one in offered)])
    # A latched publisher that kept all of its messages would hold the whole bag in memory.
    return topics.quality(depth, latched, reliable, keep_all=every and reliable and not latched)
