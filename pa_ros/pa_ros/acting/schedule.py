"""Which weights may act when: the synchronous protocol of docs/DESIGN.md."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Schedule:
    """A learner that has accepted v trajectories publishes version v.

    With one agent, what acts on which trajectory is then fixed, however fast either side is. Lag 0
    makes acting and learning take turns; lag 1 lets the agent act on trajectory m while the learner
    works on trajectory m − 1.
    """

    policy_lag: int

    def acting_version(self, trajectory: int) -> int:
        """Version that acts on trajectory 0, 1, 2, … of an agent."""
        return max(0, trajectory - self.policy_lag)

    @property
    def versions_kept(self) -> int:
        """How many of the newest versions a learner can still be asked for."""
        return self.policy_lag + 1
