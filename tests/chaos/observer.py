"""What an outsider sees of a graph: what was published, what was learned, what nodes say."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Final

import numpy as np
from rclpy.node import Node

from chaos.ledger import Ledger
from pa_ros.core.errors import PaError
from pa_ros.core.experience import AgentKey, Float64, TrajectoryKey
from pa_ros.core.published import LearnerInfo
from pa_ros.ros import topics
from pa_ros.ros.health import LEARNER_ID
from pa_ros.ros.peers import PeerMonitor, is_restarted_learner
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription, decode_arena_info
from pa_ros.wire.diagnostics import Health, decode_diagnostics
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.learning import decode_learner_info, decode_trajectory_key, decode_weights
from pa_ros.wire.step import decode_joints

TROUBLE: Final = ("refused", "duplicate", "missing", "lost", "rejected", "interrupted", "holds")
STRANGER: Final = "stranger"  # learner, agent and arena that none of ours is
GONE_S: Final = 3.0  # a node that has said nothing for so long isn't counted as OK


class Observer:
    """Hears a graph from `node`'s namespace; nothing in it is told to the graph."""

    def __init__(self, node: Node) -> None:
        self.arena: ArenaDescription | None = None
        self._learners = PeerMonitor("learner", self._on_new_learner, is_restarted_learner)
        self._announcements: dict[str, Message] = {}  # by learner
        self.account = Ledger()
        self.forgeries = 0  # trajectories that strangers sent
        self.forged: set[TrajectoryKey] = set()  # sent by strangers
        self.steps = 0  # control steps observed
        self.last: dict[str, Message] = {}  # by topic
        self.positions: deque[tuple[float, Float64]] = deque(maxlen=2000)  # rad
        self.went_back = 0  # versions lower than the one before, of one process
        self._reached: dict[str, int] = {}  # newest version of the learner that is there
        self._prefix = node.get_namespace().rstrip("/") + "/"
        self._health: dict[str, tuple[Health, float]] = {}
        self._seen: list[tuple[float, str]] = []  # when, and what nodes said of trouble
        self._baseline: dict[tuple[str, str], float] = {}
        self._stamp = -1
        for topic, callback in (
            (topics.ARENA_INFO, self._on_arena),
            (topics.LEARNER_INFO, self._on_learner),
            (topics.TRAJECTORIES, self._on_trajectory),
            (topics.POLICY_WEIGHTS, self._on_weights),
            (topics.JOINT_STATES, self._on_joints),
            (topics.JOINT_COMMANDS, self._keep("joint_commands")),
            (topics.DIAGNOSTICS, self._on_diagnostics),
        ):
            topic.subscribe(node, callback)

    @property
    def learner(self) -> LearnerInfo | None:
        """The one that agents act for."""
        return self._learners.current

    def value(self, node: str, key: str) -> float:
        """A figure that a node reported last; 0 if it has not."""
        entry = self._health.get(self._prefix + node)
        try:
            return float(entry[0].values[key]) if entry else 0.0
        except (KeyError, ValueError):
            return 0.0

    def text(self, node: str, key: str) -> str:
        """The same as text."""
        entry = self._health.get(self._prefix + node)
        return entry[0].values.get(key, "") if entry else ""

    def all_ok(self, nodes: tuple[str, ...]) -> bool:
        """Whether each has said OK lately."""
        now = time.monotonic()
        entries = [self._health.get(self._prefix + node) for node in nodes]
        return all(e is not None and e[0].level == 0 and now - e[1] < GONE_S for e in entries)

    def forget(self) -> None:
        """From here on `seen` tells of what comes."""
        self._seen.clear()
        self._baseline = {
            (name, key): float(value)
            for name, (health, _) in self._health.items()
            for key, value in health.values.items()
            if key.startswith(TROUBLE) and value.isdecimal()
        }

    @property
    def seen(self) -> tuple[float, str] | None:
        """The first thing that a node said of trouble since, and when; None: none has."""
        return self._seen[0] if self._seen else None

    def says(self) -> str:
        """What all nodes say now, for a row that failed."""
        now = time.monotonic()
        return "; ".join(
            f"{name.rpartition('/')[2]}: {health.message} (level {health.level}"
            + (f", silent for {now - at:.0f} s)" if now - at > GONE_S else ")")
            for name, (health, at) in sorted(self._health.items())
        )

    def unexplained(self) -> int:
        """Trajectories published that are neither learned, refused, reported lost nor under way.

        Negative if more was learned than published.
        """
        living = {entry.values.get("agent_id", "") for entry, _ in self._health.values()}
        refused = self.value("learner_node", "rejected_trajectories")
        told = max(0.0, refused - self.forgeries)  # of ours
        told += self.value("learner_node", "lost_trajectories")
        return self.account.unexplained(living, int(told))

    def moved(self, since: float) -> float:
        """Largest way of a joint since then, rad."""
        kept = [position for at, position in self.positions if at >= since]
        return float(np.ptp(np.array(kept), axis=0).max()) if kept else 0.0

    def _keep(self, name: str) -> Callable[[Message], None]:
        def keep(message: Message) -> None:
            self.last[name] = message

        return keep

    def _on_arena(self, message: Message) -> None:
        try:
            arena = decode_arena_info(message)
        except PaError:
            return
        if arena.arena_id != STRANGER:
            self.arena, self.last["arena_info"] = arena, message

    def _on_learner(self, message: Message) -> None:
        try:
            info = decode_learner_info(message)
        except PaError:
            return
        if info.learner_id != STRANGER:
            self._announcements[info.learner_id] = message
            self._learners.described(info.learner_id, info)

    def _on_new_learner(self, learner: LearnerInfo) -> None:
        self.last["learner_info"] = self._announcements[learner.learner_id]

    def _on_trajectory(self, message: Message) -> None:
        key = decode_trajectory_key(message)
        if key not in self.forged:
            self.account.sent(AgentKey(key.agent_id, key.incarnation), key.sequence)
            self.last["trajectories"] = message

    def _on_weights(self, message: Message) -> None:
        try:
            policy = decode_weights(message)
        except PaError:
            return
        if self.learner is None or not self._learners.received(policy.learner_id):
            return
        version = policy.snapshot.version
        if version < self._reached.get(policy.learner_id, 0):
            self.went_back += version >= self.learner.first_version
        self._reached = {policy.learner_id: version}
        self.account.learned(version, policy.accounted)
        self.last["policy_weights"] = message

    def _on_joints(self, message: Message) -> None:
        stamp = header_stamp(message)
        self.steps += stamp != self._stamp
        self._stamp = stamp
        try:
            self.positions.append((time.monotonic(), decode_joints(message, ())[0]))
        except PaError:
            return

    def _on_diagnostics(self, message: Message) -> None:
        for health in decode_diagnostics(message):
            if not health.name.startswith(self._prefix):
                continue
            self._health[health.name] = health, time.monotonic()
            self._learners.received(health.values.get(LEARNER_ID, ""))
            said = f"{health.name.rpartition('/')[2]}: {health.message}"
            if health.level:
                self._seen.append((time.monotonic(), said))
            for key, value in health.values.items():
                known = self._baseline.get((health.name, key), 0.0)
                if key.startswith(TROUBLE) and value.isdecimal() and float(value) > known:
                    said = f"{health.name.rpartition('/')[2]}: {key} {value}"
                    self._seen.append((time.monotonic(), said))
