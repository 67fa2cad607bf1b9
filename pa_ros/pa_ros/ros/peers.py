"""The arena, learner and agents that a node follows, and the publishers that it ignores.

On loopback every well-formed message is trusted, but there should be one arena, one learner, and
one agent for each arena. If there are two, all nodes must keep to the same one: mixing the steps
of two arenas, or the weights of two learners, would corrupt what is learned. Beyond loopback the
signing key (parameter `auth_key_file`) decides whose messages count at all.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from pa_ros.core.experience import AgentKey, LearnerInfo

SILENT_S = 2.5  # without data for so long, the followed peer may be replaced
REPORTED_S = 3.0  # an ignored peer is reported for so long after its last message
EARLY_S = 1.0  # data may arrive so long before the description of their sender
REMEMBERED = 16  # peers

Info = TypeVar("Info")  # a peer's description of itself
Value = TypeVar("Value")


class PeerMonitor(Generic[Info]):
    """Follows one peer of a kind, ignores the others, and names them in `fault`.

    A peer describes itself, and sends data: an arena its steps, a learner its weights and its
    diagnostics. The followed peer stays while its data arrive. When it has been silent for
    SILENT_S, another one that has described itself and whose data arrive takes over; the same one,
    started again, takes over at once. Until data arrive, the newest description counts, so a node
    that only describes itself can't keep this one from the real peer.
    """

    def __init__(
        self,
        kind: str,
        on_change: Callable[[Info], None] = lambda info: None,
        is_restart: Callable[[Info, Info], bool] = lambda before, now: False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        :param kind: what the peers are, for people: "arena".
        :param on_change: receives the description of the peer that is followed from now on.
        :param is_restart: whether a peer is the followed one (first argument), started again.
        """
        self.current: Info | None = None  # description of the followed peer
        self._kind, self._on_change, self._is_restart = kind, on_change, is_restart
        self._clock = clock
        self._followed: Hashable | None = None  # its id
        self._data_at = -math.inf  # when its data arrived last
        self._others: dict[Hashable, Info] = {}  # descriptions of the others, by id
        self._others_data_at: dict[Hashable, float] = {}
        # The actions of each ignored peer, and when it was noticed first and last.
        self._ignored: dict[Hashable, tuple[str, float, float]] = {}

    def described(self, peer: Hashable, info: Info) -> None:
        """Take note that a peer described itself. For each id the first description counts."""
        known = self.current if peer == self._followed else self._others.get(peer, info)
        if info != known:  # somebody else uses its id: an id is new at every start
            self._ignore(peer, "is described differently than before")
        elif peer == self._followed:
            return
        elif self._data_at == -math.inf:
            self._follow(peer, info)
        else:
            _remember(self._others, peer, info)
            self._consider(peer)

    def knows(self, peer: Hashable) -> bool:
        """Whether a peer described itself."""
        return peer == self._followed or peer in self._others

    def received(self, peer: Hashable, info: Info | None = None) -> bool:
        """Take note that data of a peer arrived; whether it is the followed one.

        :param info: its description, if each of its data contains that.
        """
        now = self._clock()
        if peer == self._followed:
            self._data_at = now
            return True
        if info is not None and peer not in self._others:
            self.described(peer, info)
            return self.received(peer)
        _remember(self._others_data_at, peer, now)
        return self._consider(peer)

    @property
    def fault(self) -> str:
        """Which peers are ignored, and what to do about it; empty if there are none."""
        now = self._clock()
        self._ignored = {p: one for p, one in self._ignored.items() if now - one[2] < REPORTED_S}
        named = [
            f"{'/'.join(map(str, peer)) if isinstance(peer, tuple) else peer} {doing}"
            for peer, (doing, first, _) in sorted(self._ignored.items())
            if peer in self._others or peer == self._followed or now - first > EARLY_S
        ]
        if not named:
            return ""
        return (
            f"a second {self._kind} is ignored ({'; '.join(named)}): stop it, or start it in "
            "another namespace"
        )

    def _is_alive(self) -> bool:
        return self._clock() - self._data_at < SILENT_S

    def _consider(self, peer: Hashable) -> bool:
        """Follow a peer that is not followed yet, if the rule says so; whether it does."""
        info, before = self._others.get(peer), self.current
        since_data_s = self._clock() - self._others_data_at.get(peer, -math.inf)
        if info is None:
            if before is not None:
                self._ignore(peer, "never described itself")
            return False
        if since_data_s > SILENT_S:
            self._ignore(peer, "describes itself, but sends nothing else")
            return False
        if before is None or not self._is_alive() or self._is_restart(before, info):
            self._follow(peer, info)
            return True
        self._ignore(peer, "sends, too")
        return False

    def _follow(self, peer: Hashable, info: Info) -> None:
        if self._followed is not None and self.current is not None and peer != self._followed:
            self._others[self._followed] = self.current
            self._data_at = -math.inf
        self.current, self._followed = info, peer
        self._data_at = self._others_data_at.pop(peer, self._data_at)
        self._others.pop(peer, None)
        self._ignored.pop(peer, None)
        self._on_change(info)

    def _ignore(self, peer: Hashable, doing: str) -> None:
        now = self._clock()
        first = self._ignored[peer][1] if peer in self._ignored else now
        _remember(self._ignored, peer, (doing, first, now))


def _remember(memory: dict[Hashable, Value], peer: Hashable, value: Value) -> None:
    """Set the value of a peer. If there are too many, forget the one that was set longest ago."""
    memory.pop(peer, None)
    memory[peer] = value
    if len(memory) > REMEMBERED:
        del memory[next(iter(memory))]


def is_restarted_learner(before: LearnerInfo, now: LearnerInfo) -> bool:
    """Whether a learner continues the run of the one before."""
    return before.run_id == now.run_id and now.stamp_ns >= before.stamp_ns


def is_restarted_agent(before: AgentKey, now: AgentKey) -> bool:
    """Whether an agent is a later incarnation of the one before."""
    return before.agent_id == now.agent_id and now.incarnation > before.incarnation
