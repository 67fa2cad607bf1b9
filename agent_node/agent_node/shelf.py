"""Policies received, and which of them may act: the synchronous protocol as an agent sees it."""

from __future__ import annotations

from dataclasses import dataclass

from pa_ros.wire.records import PublishedPolicy

UNPUBLISHED = -2  # no version, not even that of an actor without weights (-1)


class PolicyShelf:
    """Policies of one learner, oldest first.

    A trajectory is accounted for in the first policy that consumed it. With one agent that is the
    version one above the trajectory's number; with several, versions grow faster.
    """

    def __init__(self, agent_id: str) -> None:
        self.agent_id = agent_id
        self._policies: list[PublishedPolicy] = []
        self._forgiven = 0  # trajectories before this one need not be accounted for

    @property
    def newest(self) -> PublishedPolicy | None:
        return self._policies[-1] if self._policies else None

    def accounted(self, policy: PublishedPolicy) -> int:
        """How many of this agent's trajectories a policy accounts for."""
        return max(policy.consumed.get(self.agent_id, -1) + 1, self._forgiven)

    def add(self, policy: PublishedPolicy, sent: int) -> None:
        """Put a policy on the shelf. `sent` counts this agent's trajectories so far.

        A learner that went back (another run, or a lower version) has lost trajectories: those
        sent so far are then waited for no more.
        """
        newest = self.newest
        if newest is not None:
            same_run = policy.run_id == newest.run_id
            if same_run and policy.snapshot.version == newest.snapshot.version:
                self._policies[-1] = policy  # accounts for more trajectories, refused ones
                return
            if not same_run or policy.snapshot.version < newest.snapshot.version:
                self._policies.clear()
                self._forgiven = sent
        self._policies.append(policy)

    def for_trajectory(self, trajectory: int, lag: int) -> PublishedPolicy | None:
        """The first policy that accounts for all trajectories before `trajectory - lag`."""
        wanted = trajectory - lag
        for index, policy in enumerate(self._policies):
            if self.accounted(policy) >= wanted:
                del self._policies[:index]  # never wanted again
                return policy
        return None


@dataclass(frozen=True)
class ShelfSchedule:
    """The schedule by what was received; equal to Schedule's own where there is one agent."""

    policy_lag: int
    shelf: PolicyShelf

    def acting_version(self, trajectory: int) -> int:
        found = self.shelf.for_trajectory(trajectory, self.policy_lag)
        return UNPUBLISHED if found is None else found.snapshot.version
