"""A bag back into a live graph: with the recorded timing, or as fast as it is taken."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Final

from pydantic import Field, model_validator
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from pa_ros.bags.errors import BagError
from pa_ros.bags.reader import Bag, Recorded
from pa_ros.core.settings import Settings
from pa_ros.ros import topics
from pa_ros.tools.graph import DISCOVERY_S
from pa_ros.wire.definitions import message_class, message_type
from pa_ros.wire.errors import WireError
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.step import encode_clock

WINDOW: Final = 20  # messages of a topic that may be under way when not paced by the clock
ACK_S: Final = 5.0  # what a reader may take to acknowledge, an arena to come to a step
ARENA_S: Final = 0.5  # in which an arena that listens to commands is seen to speak, too
CLOCK_PERIOD_S: Final = 0.01
LONGEST_S: Final = 1e9
SLOWEST: Final = 1e-6  # of the rates that are paced
FASTEST: Final = 1e6
_LAST_NS: Final = 2**63 - 1  # that storages can ask for
_SPIN_S: Final = 0.0005  # before a message is due: sleeping is not that exact
_NAP_S: Final = 0.0002


class PlaybackError(BagError):
    """The graph does not take what is played."""

    code = "playback"


class PlaybackOptions(Settings):
    """What of a bag is played, and how fast."""

    SECTION: ClassVar[str] = "playback"

    rate: float = Field(
        1.0, ge=0, le=FASTEST, description="times the recorded speed; 0: as fast as it is taken"
    )
    topics: tuple[str, ...] = Field((), description="full names, or their last parts; none: all")
    start_s: float = Field(
        0.0, ge=0, le=LONGEST_S, description="seconds after the bag's first message"
    )
    duration_s: float = Field(
        0.0, ge=0, le=LONGEST_S, description="seconds of recorded time; 0: to the end"
    )
    loop: bool = Field(False, description="again and again, until stopped")
    clock: bool = Field(False, description="publish /clock by the recorded times")
    wait_s: float = Field(
        DISCOVERY_S,
        ge=0,
        le=LONGEST_S,
        description="seconds, at most, for someone to listen to each topic",
    )

    @model_validator(mode="after")
    def _paced(self) -> PlaybackOptions:
        if 0.0 < self.rate < SLOWEST:
            raise ValueError(f"rate: expected 0 or at least {SLOWEST:g}, got {self.rate:g}")
        return self


@dataclass
class Played:
    """What was published."""

    counts: dict[str, int] = field(default_factory=dict)  # messages by topic
    late_s: deque[float] = field(default_factory=lambda: deque(maxlen=100_000))  # behind schedule
    passed_over: dict[str, str] = field(default_factory=dict)  # topics that cannot be, and why
    unheard: list[str] = field(default_factory=list)  # topics that nobody listened to at the start


class Player:
    """Publishes what a bag holds, as bytes, with the quality of service stated in it.

    A joint command waits for the arena to come to the step that it answers, if an arena is there:
    in lockstep, from the same seed, it does so exactly as recorded. Raises BagError if the
    bag has none of the topics.
    """

    def __init__(self, bag: Bag, node: Node, options: PlaybackOptions | None = None) -> None:
        self.played = Played()
        self._bag, self._node = bag, node
        self._options = options or PlaybackOptions()
        self._publishers: dict[str, Any] = {}
        self._under_way: dict[str, int] = {}
        for name in self._chosen():
            self._advertise(name)
        if not self._publishers:
            raise BagError(f"bag: {bag.path}: nothing to play: {self.played.passed_over}")
        self._clock = topics.ROS_CLOCK.publisher(node) if self._options.clock else None
        self._gates = {
            name: _Gate(node, name)
            for name in self._publishers
            if bag.types[name] == message_type(topics.JOINT_COMMANDS.type)
        }

    def run(self, stopped: Callable[[], bool] = lambda: False) -> Played:
        """Play to the end, or until `stopped`. Raises PlaybackError, DamagedBagError."""
        if 0.0 < self._options.start_s >= self._bag.duration_s:
            raise PlaybackError(
                f"playback: --start: expected less than the bag's {self._bag.duration_s:g} s, "
                f"got {self._options.start_s:g}"
            )
        self._wait_for_listeners(stopped)
        for gate in self._gates.values():
            gate.look(set(self._publishers))
        first_ns = self._bag.first_ns + int(self._options.start_s * 1e9)
        self._latch(first_ns)
        while not stopped():
            before = self._total
            self._pass(first_ns, stopped)
            if not self._options.loop or self._total == before:
                break
        for name in self._publishers:
            self._settle(name)
        return self.played

    @property
    def _total(self) -> int:
        return sum(self.played.counts.values())

    def _chosen(self) -> list[str]:
        there, wanted = self._bag.types, self._options.topics
        if not wanted:
            instead = topics.ROS_CLOCK.name if self._options.clock else ""
            return [name for name in there if name != instead]
        found = []
        for one in wanted:
            named = [name for name in there if name == one or name.endswith("/" + one.lstrip("/"))]
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
            self.played.passed_over[name] = f"{type_name} is not installed here"
            return
        profile = _profile(self._bag, name, keep_all=self._options.rate == 0.0)
        self._publishers[name] = self._node.create_publisher(kind, name, profile)
        self._under_way[name] = self.played.counts[name] = 0

    def _wait_for_listeners(self, stopped: Callable[[], bool]) -> None:
        deadline = time.monotonic() + self._options.wait_s
        waiting = list(self._publishers)
        while waiting and time.monotonic() < deadline and not stopped():
            time.sleep(0.02)
            waiting = [n for n in waiting if not self._publishers[n].get_subscription_count()]
        self.played.unheard = waiting

    def _latch(self, first_ns: int) -> None:
        """What late joiners would have been told at `first_ns`."""
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

    def _pass(self, first_ns: int, stopped: Callable[[], bool]) -> None:
        started = time.perf_counter()
        for recorded in self._messages(first_ns):
            if self._options.rate:
                due = started + (recorded.stamp_ns - first_ns) / 1e9 / self._options.rate
                if not self._sleep_until(due, recorded.stamp_ns, stopped):
                    return
                self.played.late_s.append(time.perf_counter() - due)
            elif stopped():
                return
            self._tell_time(recorded.stamp_ns)
            gate = self._gates.get(recorded.topic)
            if gate is not None:
                gate.wait(header_stamp(self._bag.deserialize(recorded)), stopped)
            self._publish(recorded)

    def _messages(self, first_ns: int) -> Iterator[Recorded]:
        stop_ns = None
        if self._options.duration_s:
            stop_ns = min(first_ns + int(self._options.duration_s * 1e9), _LAST_NS)
        return self._bag.messages(self._publishers, first_ns, stop_ns)

    def _sleep_until(self, due: float, stamp_ns: int, stopped: Callable[[], bool]) -> bool:
        """False if stopped meanwhile."""
        while (left := due - time.perf_counter()) > 0:
            if left > CLOCK_PERIOD_S:
                if stopped():
                    return False
                self._tell_time(stamp_ns - int(left * self._options.rate * 1e9))
            if left > _SPIN_S:
                time.sleep(min(left - _SPIN_S, CLOCK_PERIOD_S))
        return not stopped()

    def _tell_time(self, stamp_ns: int) -> None:
        if self._clock is not None:
            self._clock.publish(encode_clock(stamp_ns))

    def _publish(self, recorded: Recorded) -> None:
        name = recorded.topic
        self._publishers[name].publish(recorded.payload)
        self.played.counts[name] += 1
        self._under_way[name] += 1
        if self._options.rate == 0.0 and self._under_way[name] >= WINDOW:
            self._settle(name)

    def _settle(self, name: str) -> None:
        """Wait until every reliable reader has what was published."""
        self._under_way[name] = 0
        publisher = self._publishers[name]
        if publisher.get_subscription_count() == 0:
            return
        if not publisher.wait_for_all_acked(Duration(seconds=ACK_S)):
            raise PlaybackError(
                f"playback: {name}: not acknowledged within {ACK_S:g} s by its readers"
            )


class _Gate:
    """Lets a command pass when the arena stands at the step that the command answers."""

    def __init__(self, node: Node, commands: str) -> None:
        self._node = node
        self._name = f"{commands.rpartition('/')[0]}/{topics.OBJECT_FEATURES.name}"
        self._subscription = replace(topics.OBJECT_FEATURES, name=self._name).subscribe(node, id)
        self._stands = -1
        self._active = False

    def look(self, played_here: set[str]) -> None:
        """Whether there is an arena to wait for; its topics are discovered one by one."""
        deadline = time.monotonic() + ARENA_S
        while not self._active and self._name not in played_here and time.monotonic() < deadline:
            time.sleep(0.02)
            self._active = self._node.count_publishers(self._name) > 0

    def wait(self, stamp_ns: int, stopped: Callable[[], bool]) -> None:
        """Raises PlaybackError if the arena does not come to that step."""
        deadline = time.monotonic() + ACK_S
        while self._active and self._newest() < stamp_ns and not stopped():
            if time.monotonic() > deadline:
                raise PlaybackError(
                    f"playback: expected the arena to come to the step of stamp {stamp_ns} ns, "
                    f"whose command is next; it stands at {self._stands} ns "
                    "(another seed or design?)"
                )
            time.sleep(_NAP_S)

    def _newest(self) -> int:
        while True:
            with self._subscription.handle:
                taken = self._subscription.handle.take_message(self._subscription.msg_type, False)
            if taken is None:
                return self._stands
            self._stands = max(self._stands, header_stamp(taken[0]))


def _profile(bag: Bag, name: str, keep_all: bool = False) -> QoSProfile:
    """What the bag says that the publishers of a topic offered; the weakest of several."""
    offered = bag.qos(name)
    if not offered:
        return topics.STEP
    reliable = all(one.reliability.name != "BEST_EFFORT" for one in offered)
    latched = all(one.durability.name == "TRANSIENT_LOCAL" for one in offered)
    every = keep_all or any(one.history.name == "KEEP_ALL" for one in offered)
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        history=HistoryPolicy.KEEP_ALL if every and reliable and not latched
        else HistoryPolicy.KEEP_LAST,
        depth=max([1, *(one.depth for one in offered)]),
    )  # fmt: skip
