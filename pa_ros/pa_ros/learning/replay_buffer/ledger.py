"""Which trajectories have arrived, so that inserting is idempotent and gaps are visible."""

from __future__ import annotations

from dataclasses import dataclass, field

Intervals = list[tuple[int, int]]  # [first, end) of sequence numbers


@dataclass
class Ledger:
    """Sequence numbers seen from each agent; duplicates counted, missing ones known.

    Memory grows with the number of separate gaps, not with their length.
    """

    duplicates: int = 0
    _next: dict[str, int] = field(default_factory=dict)
    _missing: dict[str, Intervals] = field(default_factory=dict)

    @property
    def missing(self) -> int:
        """Trajectories that were skipped and have not arrived since, over all agents."""
        return sum(end - first for gaps in self._missing.values() for first, end in gaps)

    def is_new(self, agent_id: str, sequence: int) -> bool:
        """Whether (agent, sequence) has not been recorded."""
        if sequence >= self._next.get(agent_id, 0):
            return True
        return any(first <= sequence < end for first, end in self._missing.get(agent_id, []))

    def record(self, agent_id: str, sequence: int) -> None:
        """Record an arrival that `is_new`; numbers skipped before it become missing."""
        expected = self._next.get(agent_id, 0)
        gaps = self._missing.setdefault(agent_id, [])
        if sequence >= expected:
            if sequence > expected:
                gaps.append((expected, sequence))
            self._next[agent_id] = sequence + 1
            return
        index = next(i for i, (first, end) in enumerate(gaps) if first <= sequence < end)
        first, end = gaps.pop(index)
        late = [(first, sequence), (sequence + 1, end)]
        gaps[index:index] = [(low, high) for low, high in late if low < high]

    def next_sequence(self, agent_id: str) -> int:
        """One more than the largest sequence number seen from an agent; 0 if none was."""
        return self._next.get(agent_id, 0)

    def to_metadata(self) -> dict[str, object]:
        """Plain values for JSON."""
        missing = {agent: [list(gap) for gap in gaps] for agent, gaps in self._missing.items()}
        return {"duplicates": self.duplicates, "next": dict(self._next), "missing": missing}

    @classmethod
    def from_metadata(cls, values: dict[str, object]) -> Ledger:
        """The inverse of `to_metadata`; KeyError, TypeError or ValueError if it is not that."""
        following, missing = values["next"], values["missing"]
        if not (isinstance(following, dict) and isinstance(missing, dict)):
            raise TypeError("ledger: expected objects 'next' and 'missing'")
        gaps = {str(k): [(int(a), int(b)) for a, b in v] for k, v in missing.items()}
        duplicates = int(str(values["duplicates"]))
        return cls(duplicates, {str(k): int(v) for k, v in following.items()}, gaps)
