"""Which trajectories have arrived, so that inserting is idempotent and gaps are visible."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

from pa_ros.core.experience import AgentKey, TrajectoryKey
from pa_ros.learning.errors import LearningError

Intervals = list[tuple[int, int]]  # [first, end) of sequence numbers


@dataclass
class SequenceTracker:
    """Sequence numbers of one agent's trajectories, in its latest incarnation."""

    incarnation: int
    next: int  # one more than the largest number that arrived or was given up
    gaps: Intervals = field(default_factory=list)  # skipped, and not arrived since

    @property
    def missing(self) -> int:
        """Trajectories that were skipped and may still arrive."""
        return sum(end - first for first, end in self.gaps)

    @property
    def accounted(self) -> int:
        """Every trajectory before this one has arrived or will never arrive."""
        return self.gaps[0][0] if self.gaps else self.next

    def is_new(self, sequence: int) -> bool:
        """Whether a number has neither arrived nor been given up."""
        return sequence >= self.next or any(first <= sequence < end for first, end in self.gaps)

    def give_up(self, before: int) -> int:
        """Expect no trajectory before this one. Returns how many are lost by that."""
        was = self.missing
        self.gaps = [(max(first, before), end) for first, end in self.gaps if end > before]
        skipped = max(0, before - self.next)
        self.next = max(self.next, before)
        return was - self.missing + skipped

    def record(self, sequence: int) -> None:
        """Record the arrival of a new number; numbers skipped before it become missing."""
        if sequence >= self.next:
            if sequence > self.next:
                self.gaps.append((self.next, sequence))
            self.next = sequence + 1
            return
        index = next(i for i, (first, end) in enumerate(self.gaps) if first <= sequence < end)
        first, end = self.gaps.pop(index)
        around = [(first, sequence), (sequence + 1, end)]
        self.gaps[index:index] = [(low, high) for low, high in around if low < high]


@dataclass
class Ledger:
    """Sequence numbers from every agent: duplicates are counted, missing and lost ones are known.

    An agent that restarts under its name is a new incarnation, which replaces the former one.
    """

    duplicates: int = 0
    lost: int = 0  # will not arrive: their agent gave them up, or is gone
    too_old: int = 0  # arrived, but rejected because of the age of the weights that acted
    agents: dict[str, SequenceTracker] = field(default_factory=dict)  # by agent_id

    @property
    def missing(self) -> int:
        """Trajectories that were skipped and have not arrived since, over all agents."""
        return sum(tracker.missing for tracker in self.agents.values())

    def missing_of(self, included: Callable[[str], bool]) -> int:
        """Missing trajectories of the agents whose agent_id is `included`."""
        agents = list(self.agents.items())  # another thread may add one meanwhile
        return sum(tracker.missing for agent_id, tracker in agents if included(agent_id))

    def check(self, agent: AgentKey) -> None:
        """Raise LearningError for an agent whose name a later incarnation uses now."""
        tracker = self.agents.get(agent.agent_id)
        if tracker is not None and agent.incarnation < tracker.incarnation:
            raise LearningError(
                f"trajectory: expected one agent called {agent.agent_id!r}, the one of "
                f"incarnation {tracker.incarnation}, got another of {agent.incarnation}",
                code="learning.superseded",
            )

    def is_new(self, key: TrajectoryKey) -> bool:
        """Whether a trajectory has not been recorded."""
        tracker = self.agents.get(key.agent_id)
        if tracker is None or key.incarnation != tracker.incarnation:
            return True
        return tracker.is_new(key.sequence)

    def record(self, key: TrajectoryKey, held_from: int = 0) -> None:
        """Record the arrival of a trajectory that `is_new`.

        `held_from`: first trajectory that its agent can still send. Of a new agent nothing before
        it is expected; of a known one, what has not arrived before it is lost.
        """
        tracker = self.agents.get(key.agent_id)
        if tracker is None or tracker.incarnation != key.incarnation:
            self.lost += tracker.missing if tracker else 0
            tracker = self.agents[key.agent_id] = SequenceTracker(key.incarnation, held_from)
        self.lost += tracker.give_up(held_from)
        tracker.record(key.sequence)

    def accounted(self) -> dict[AgentKey, int]:
        """For each agent, the first trajectory that is not accounted for."""
        return {
            AgentKey(agent_id, tracker.incarnation): tracker.accounted
            for agent_id, tracker in self.agents.items()
        }

    def to_metadata(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)

    @classmethod
    def from_metadata(cls, values: dict[str, Any]) -> Ledger:
        """The inverse of `to_metadata`."""
        agents = {
            agent_id: SequenceTracker(
                one["incarnation"], one["next"], [(first, end) for first, end in one["gaps"]]
            )
            for agent_id, one in values["agents"].items()
        }
        return cls(**{**values, "agents": agents})
