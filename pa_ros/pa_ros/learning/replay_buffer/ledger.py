"""Which trajectories have arrived, so that inserting is idempotent and gaps are visible."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from pa_ros.core.experience import AgentKey, TrajectoryKey

Intervals = list[tuple[int, int]]  # [first, end) of sequence numbers


@dataclass
class SequenceTracker:
    """Sequence numbers of one agent's trajectories, in one incarnation."""

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

    Every number before `next` of its agent is learned, rejected, lost or missing. An agent that
    restarts is a new incarnation with numbers of its own, so nobody who uses its name can make its
    trajectories look like duplicates.
    """

    duplicates: int = 0
    lost: int = 0  # will not arrive: their agent gave them up, or is gone
    rejected: int = 0  # arrived, but could not be learned from
    agents: dict[AgentKey, SequenceTracker] = field(default_factory=dict)

    @property
    def missing(self) -> int:
        """Trajectories that were skipped and have not arrived since, over all agents."""
        return self.missing_of(lambda agent_id: True)

    def missing_of(self, included: Callable[[str], bool]) -> int:
        """Missing trajectories of the agents whose agent_id is `included`."""
        agents = list(self.agents.items())  # another thread may add one meanwhile
        return sum(tracker.missing for agent, tracker in agents if included(agent.agent_id))

    def is_new(self, key: TrajectoryKey) -> bool:
        """Whether a trajectory has not been recorded."""
        tracker = self.agents.get(AgentKey(key.agent_id, key.incarnation))
        return tracker is None or tracker.is_new(key.sequence)

    def record(self, key: TrajectoryKey, held_from: int = 0, first_of_run: int = 0) -> None:
        """Record the arrival of a trajectory that `is_new`.

        :param held_from: first trajectory that its agent can still send; what has not arrived
            before it is lost.
        :param first_of_run: first trajectory that its agent sent for this run.
        """
        agent = AgentKey(key.agent_id, key.incarnation)
        if agent not in self.agents:
            for other, tracker in self.agents.items():
                if other.agent_id == agent.agent_id:  # it has restarted
                    self.lost += tracker.give_up(tracker.next)
            self.agents[agent] = SequenceTracker(first_of_run)
        self.lost += self.agents[agent].give_up(held_from)
        self.agents[agent].record(key.sequence)

    def accounted(self) -> dict[AgentKey, int]:
        """The first trajectory of each agent that is not accounted for."""
        return {agent: tracker.accounted for agent, tracker in self.agents.items()}

    def to_metadata(self) -> dict[str, Any]:
        """Plain values for JSON."""
        agents = [{**agent._asdict(), **asdict(one)} for agent, one in self.agents.items()]
        return {**asdict(replace(self, agents={})), "agents": agents}

    @classmethod
    def from_metadata(cls, values: dict[str, Any]) -> Ledger:
        """The inverse of `to_metadata`."""
        agents = {
            AgentKey(one["agent_id"], one["incarnation"]): SequenceTracker(
                one["next"], [(first, end) for first, end in one["gaps"]]
            )
            for one in values["agents"]
        }
        return cls(**{**values, "agents": agents})
