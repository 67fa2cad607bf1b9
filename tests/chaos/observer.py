"""What is published on a graph: trajectories, versions of the weights, steps, diagnostics."""

import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

import numpy as np
from rclpy.node import Node

from pa_ros.core.errors import PaError
from pa_ros.core.experience import AgentKey, Float64, LearnerInfo, TrajectoryKey
from pa_ros.ros import topics
from pa_ros.ros.health import LEARNER_ID
from pa_ros.ros.peers import PeerMonitor, is_restarted_learner
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription, decode_arena_info
from pa_ros.wire.diagnostics import Health, decode_diagnostics
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.learning import decode_learner_info, decode_trajectory_key, decode_weights

TROUBLE: Final = ("refused", "duplicate", "missing", "lost", "rejected", "interrupted", "holds")
STRANGER: Final = "stranger"  # the id in forged messages
SILENT_S: Final = 3.0  # a node without diagnostics for so long does not count as OK


class Observer:
    """Subscribes to a graph in the namespace of `node` and keeps what it needs to judge it."""

    def __init__(self, node: Node) -> None:
        self.arena: ArenaDescription | None = None
        self.ledger = Ledger()
        self.forged: set[TrajectoryKey] = set()  # trajectories sent that nothing may come of
        self.steps = 0  # control steps
        self.last: dict[str, Message] = {}  # by topic
        self.positions: deque[tuple[float, Float64]] = deque(maxlen=2000)  # time, joints (rad)
        self.went_back = 0  # times that a version was lower than the one before it
        self._learners = PeerMonitor("learner", self._on_new_learner, is_restarted_learner)
        self._announcements: dict[str, Message] = {}  # by learner
        self._newest: dict[str, int] = {}  # version of the current learner
        self._prefix = node.get_namespace().rstrip("/") + "/"
        self._health: dict[str, tuple[Health, float]] = {}
        self._reports: list[tuple[float, str]] = []  # trouble that nodes reported, and when
        self._baseline: dict[tuple[str, str], float] = {}
        self._stamp = -1
        for topic, callback in (
            (topics.ARENA_INFO, self._on_arena),
            (topics.LEARNER_INFO, self._on_learner),
            (topics.TRAJECTORIES, self._on_trajectory),
            (topics.POLICY_WEIGHTS, self._on_weights),
            (topics.JOINT_STATES, self._on_joints),
            (topics.OBJECT_FEATURES, self._on_features),
            (topics.JOINT_COMMANDS, self._on_command),
            (topics.DIAGNOSTICS, self._on_diagnostics),
        ):
            topic.subscribe(node, _ignoring_errors(callback))

    @property
    def learner(self) -> LearnerInfo | None:
        """The learner that agents follow."""
        return self._learners.current

    def value(self, node: str, key: str) -> float:
        """The latest figure of a node; 0 without any."""
        try:
            return float(self.text(node, key))
        except ValueError:
            return 0.0

    def text(self, node: str, key: str) -> str:
        """The latest value of a node's diagnostics; empty without any."""
        entry = self._health.get(self._prefix + node)
        return entry[0].values.get(key, "") if entry else ""

    def all_ok(self, nodes: tuple[str, ...]) -> bool:
        """Whether each node has reported OK lately."""
        now = time.monotonic()
        entries = [self._health.get(self._prefix + node) for node in nodes]
        return all(e is not None and e[0].level == 0 and now - e[1] < SILENT_S for e in entries)

    def forget_reports(self) -> None:
        """Start to collect reports of trouble anew."""
        self._reports.clear()
        self._baseline = {
            (name, key): float(value)
            for name, (health, _) in self._health.items()
            for key, value in health.values.items()
            if key.startswith(TROUBLE) and value.isdecimal()
        }

    @property
    def first_report(self) -> tuple[float, str] | None:
        """When a node first reported trouble, and its message."""
        return self._reports[0] if self._reports else None

    def summary(self) -> str:
        """What all nodes report now."""
        now = time.monotonic()
        return "; ".join(
            f"{name.rpartition('/')[2]}: {health.message} (level {health.level}"
            + (f", silent for {now - at:.0f} s)" if now - at > SILENT_S else ")")
            for name, (health, at) in sorted(self._health.items())
        )

    def unexplained(self) -> int:
        """Trajectories published that are neither learned, rejected, reported lost nor in flight.

        Negative if more was learned than published.
        """
        living = {entry.values.get("agent_id", "") for entry, _ in self._health.values()}
        strange = sum(key.agent_id == STRANGER for key in self.forged)
        reported = max(0.0, self.value("learner_node", "rejected_trajectories") - strange)
        reported += self.value("learner_node", "lost_trajectories")
        return self.ledger.unexplained(living, int(reported))

    def moved(self, since: float) -> float:
        """The largest movement of a joint since then, rad."""
        kept = [position for at, position in self.positions if at >= since]
        return float(np.ptp(np.array(kept), axis=0).max()) if kept else 0.0

    def _on_arena(self, message: Message) -> None:
        arena = decode_arena_info(message)
        known = self.arena.arena_id if self.arena is not None else STRANGER
        if arena.arena_id not in (STRANGER, known):  # the first description of an id counts
            self.arena, self.last["arena_info"] = arena, message

    def _on_learner(self, message: Message) -> None:
        info = decode_learner_info(message)
        if info.learner_id != STRANGER:
            self._announcements.setdefault(info.learner_id, message)
            self._learners.described(info.learner_id, info)

    def _on_new_learner(self, learner: LearnerInfo) -> None:
        self.last["learner_info"] = self._announcements[learner.learner_id]

    def _on_trajectory(self, message: Message) -> None:
        key = decode_trajectory_key(message)
        if key not in self.forged:
            self.ledger.published(AgentKey(key.agent_id, key.incarnation), key.sequence)
            self.last["trajectories"] = message

    def _on_weights(self, message: Message) -> None:
        policy = decode_weights(message)
        if self.learner is None or not self._learners.received(policy.learner_id):
            return
        version = policy.snapshot.version
        if version < self._newest.get(policy.learner_id, 0):
            self.went_back += version >= self.learner.first_version
        self._newest = {policy.learner_id: version}
        self.ledger.learned(version, policy.accounted)
        self.last["policy_weights"] = message

    def _on_joints(self, message: Any) -> None:
        stamp = header_stamp(message)
        self.steps += stamp != self._stamp
        self._stamp = stamp
        self.positions.append((time.monotonic(), np.array(message.position)))

    def _on_features(self, message: Message) -> None:
        self.last["object_features"] = message

    def _on_command(self, message: Message) -> None:
        self.last["joint_commands"] = message

    def _on_diagnostics(self, message: Message) -> None:
        now = time.monotonic()
        for health in decode_diagnostics(message):
            if not health.name.startswith(self._prefix):
                continue
            self._health[health.name] = health, now
            self._learners.received(health.values.get(LEARNER_ID, ""))
            node = health.name.rpartition("/")[2]
            if health.level:
                self._reports.append((now, f"{node}: {health.message}"))
            for key, value in health.values.items():
                known = self._baseline.get((health.name, key), 0.0)
                if key.startswith(TROUBLE) and value.isdecimal() and float(value) > known:
                    self._reports.append((now, f"{node}: {key} {value}"))


def _ignoring_errors(callback: Callable[[Message], None]) -> Callable[[Message], None]:
    """An observer ignores messages that cannot be decoded; the nodes reject and count them."""

    def receive(message: Message) -> None:
        try:
            callback(message)
        except PaError:
            return

    return receive


class Ledger:
    """What agents published and a learner learned, as counted from outside."""

    def __init__(self) -> None:
        self.version = 0
        # Trajectories accounted for, by the newest weights and by any: a restarted learner may
        # resume from before what its predecessor had learned.
        self._accounted: dict[AgentKey, int] = {}
        self._ever: dict[AgentKey, int] = {}
        # One more than the highest sequence number: messages of a new agent may be missed at first,
        # since subscribers discover it one after the other.
        self._published: dict[AgentKey, int] = {}

    @property
    def accounted(self) -> int:
        """Trajectories that the newest weights account for."""
        return sum(self._accounted.values())

    def published(self, agent: AgentKey, sequence: int) -> None:
        """A trajectory was published."""
        self._published[agent] = max(self._published.get(agent, 0), sequence + 1)

    def learned(self, version: int, accounted: Mapping[AgentKey, int]) -> None:
        """Weights were published."""
        self.version, self._accounted = version, dict(accounted)
        for agent, count in accounted.items():
            self._ever[agent] = max(self._ever.get(agent, 0), count)

    def unexplained(self, living: Collection[str], reported: int) -> int:
        """Trajectories published that are neither learned, nor among the `reported` ones (rejected
        or lost), nor in flight from a living agent.

        What a dead agent had sent and a killed learner had learned after its newest checkpoint is
        lost with it, and no further loss. Negative if more was learned than published.
        """
        accounted = lost = 0
        for agent, seen in self._published.items():
            ever = self._ever.get(agent, 0)
            dead = agent.agent_id not in living
            # Some subscribers receive what a killed agent was just sending, others do not.
            sent = seen + (dead and ever > seen)
            accounted += min(self._accounted.get(agent, 0), sent)
            lost += max(0, sent - ever) if dead else 0
        return accounted - self.version - reported + lost
