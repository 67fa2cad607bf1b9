"""Which trajectories have arrived, so that inserting is idempotent and gaps are visible."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from pa_ros.core.experience import AgentKey, TrajectoryKey
from pa_ros.learning.errors import LearningError
from pa_ros.world import Trajectory

Intervals = list[tuple[int, int]]  # [first, end) of sequence numbers
UNTAKEN = 256  # agents remembered that only sent what was refused


@dataclass
class Account:
    """One agent's trajectories, of its latest incarnation."""

    incarnation: int
    next: int  # one more than the largest sequence number seen, or given up
    gaps: Intervals = field(default_factory=list)  # skipped, not arrived since
    taken: bool = True  # whether anything of it was; if not, nothing of it is missed or lost

    @property
    def missing(self) -> int:
        """Trajectories that were skipped and may still come."""
        return sum(end - first for first, end in self.gaps) if self.taken else 0

    @property
    def accounted(self) -> int:
        """Every trajectory before this one has arrived, or will not come."""
        return self.gaps[0][0] if self.gaps else self.next

    def give_up(self, before: int) -> int:
        """Wait for no trajectory before this one; how many of them are lost."""
        was = self.missing
        self.gaps = [(max(first, before), end) for first, end in self.gaps if end > before]
        skipped = max(0, before - self.next)
        self.next = max(self.next, before)
        return was - self.missing + skipped if self.taken else 0

    def record(self, sequence: int) -> None:
        """An arrival; numbers skipped before it become missing."""
        if sequence >= self.next:
            if sequence > self.next:
                self.gaps.append((self.next, sequence))
            self.next = sequence + 1
            return
        index = next(i for i, (first, end) in enumerate(self.gaps) if first <= sequence < end)
        first, end = self.gaps.pop(index)
        late = [(first, sequence), (sequence + 1, end)]
        self.gaps[index:index] = [(low, high) for low, high in late if low < high]


@dataclass
class Ledger:
    """Sequence numbers seen from each agent: duplicates counted, missing and lost ones known.

    An agent that starts again under its name is another incarnation, with an account of its own
    that takes the former's place. Memory grows with the number of agents' names and of separate
    gaps, not with the gaps' length.
    """

    duplicates: int = 0
    lost: int = 0  # will not come: their agent gave them up, or is gone
    too_old: int = 0  # came, but were not learned from for the age of the weights that acted
    accounts: dict[str, Account] = field(default_factory=dict)

    @property
    def missing(self) -> int:
        """Trajectories that were skipped and have not arrived since, over all agents."""
        return sum(account.missing for account in self.accounts.values())

    def check(self, trajectory: Trajectory) -> None:
        """Raise LearningError for an agent whose name a later incarnation has taken."""
        account = self.accounts.get(trajectory.agent_id)
        if account is not None and trajectory.incarnation < account.incarnation:
            raise LearningError(
                f"trajectory: expected one agent called {trajectory.agent_id!r}, the one of "
                f"incarnation {account.incarnation}, got another of {trajectory.incarnation}",
                code="learning.superseded",
            )

    def is_new(self, key: TrajectoryKey) -> bool:
        """Whether a trajectory has not been recorded."""
        account = self.accounts.get(key.agent_id)
        if account is None or key.incarnation != account.incarnation:
            return True
        if key.sequence >= account.next:
            return True
        return any(first <= key.sequence < end for first, end in account.gaps)

    def record(self, key: TrajectoryKey, held_from: int = 0, taken: bool = True) -> None:
        """Record an arrival that `is_new`, from an agent that still holds what is asked.

        Of a new account, nothing before `held_from` is missed; else what the agent holds no more
        and has not arrived is lost. `taken`: whether it is learned from; what an agent of which
        nothing ever was says of its other trajectories is not believed.
        """
        account = self.accounts.get(key.agent_id)
        if account is None or account.incarnation != key.incarnation:
            self.lost += account.missing if account else 0
            account = Account(key.incarnation, held_from, taken=False)
            self.accounts.pop(key.agent_id, None)  # the newest last
            self.accounts[key.agent_id] = account
            self._forget_untaken()
        self.lost += account.give_up(held_from)
        account.record(key.sequence)
        account.taken |= taken

    def _forget_untaken(self) -> None:
        untaken = [name for name, account in self.accounts.items() if not account.taken]
        for name in untaken[:-UNTAKEN]:
            del self.accounts[name]

    def accounted(self) -> dict[AgentKey, int]:
        """Of each agent, the first trajectory that is not accounted for."""
        return {
            AgentKey(agent_id, account.incarnation): account.accounted
            for agent_id, account in self.accounts.items()
        }

    def to_metadata(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)

    @classmethod
    def from_metadata(cls, values: dict[str, Any]) -> Ledger:
        """The inverse of `to_metadata`; KeyError, TypeError or ValueError if it is not that."""
        accounts = {
            str(agent_id): Account(
                int(one["incarnation"]),
                int(one["next"]),
                _intervals(one["gaps"]),
                bool(one["taken"]),
            )
            for agent_id, one in values["accounts"].items()
        }
        counts = int(values["duplicates"]), int(values["lost"]), int(values["too_old"])
        return cls(*counts, accounts)


def _intervals(values: Any) -> Intervals:
    return [(int(first), int(end)) for first, end in values]
