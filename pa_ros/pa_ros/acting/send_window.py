"""Which weights may act, and which trajectories an agent may have to send again.

These are the rules of docs/DESIGN.md, "The synchronous protocol", on the agent's side.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from pa_ros.core.experience import AgentKey, LearnerInfo, PublishedPolicy
from pa_ros.world import Trajectory

FREE_WINDOW = 64  # trajectories that a free agent keeps while its learner accepts none
RESENT_AT_ONCE = 4  # of these, sent again in each resend period


@dataclass(frozen=True, slots=True)
class Wait:
    """The agent may not act yet."""

    reason: str  # what it waits for


class SendWindow:
    """The rule of a learning agent, for one learner's run.

    Trajectory m is acted by the first weights that account for all trajectories before
    m − policy_lag. For the first trajectories that rule names no weights. The agent then counts all
    versions up to the learner's start as its own, so a resumed run continues as if it had never
    stopped.

    Sent trajectories are kept until weights account for them. If the learner lost some that are no
    longer kept (it was killed, and resumed from an earlier checkpoint), they are given up: each
    trajectory says from which number on its agent still holds them, so neither side waits.
    """

    def __init__(self, agent: AgentKey, first_sequence: int, learner: LearnerInfo) -> None:
        """`first_sequence`: number of the first trajectory for this run."""
        self.learner = learner
        self.lost = 0  # trajectories given up
        self.stalled = False  # the agent does not wait, and the learner accepts nothing
        self.overtaken = False  # the learner has trajectories in its name that it never sent
        self._agent = agent
        self._first = self._next = self._given_up = first_sequence
        self._started_at = learner.first_version
        self._sent: list[Trajectory] = []  # not accounted for yet
        self._policies: list[PublishedPolicy] = []  # those that may still have to act, oldest first

    @property
    def unaccounted(self) -> list[Trajectory]:
        """Trajectories that may have to be sent again, ready to be sent."""
        return [self._as_held(trajectory) for trajectory in self._sent]

    def add(self, trajectory: Trajectory) -> Trajectory:
        """Keep the next trajectory until it is accounted for. Returns it ready to be sent."""
        self._sent.append(trajectory)
        self._next = trajectory.sequence + 1
        return self._as_held(trajectory)

    def resume(self, learner: LearnerInfo) -> None:
        """Continue the run with another learner, which knows nothing after its first version."""
        self.learner = learner
        last = learner.first_version
        self._policies = [one for one in self._policies if one.snapshot.version <= last]

    def receive(self, policy: PublishedPolicy) -> None:
        """Take in weights that this learner published; a repeated version replaces the earlier."""
        version = policy.snapshot.version
        others = [one for one in self._policies if one.snapshot.version != version]
        if others and version < others[0].snapshot.version:
            return  # published before the learner's start: newer ones are in use
        self._policies = sorted([*others, policy], key=lambda one: one.snapshot.version)
        if version >= self.learner.first_version:
            self._settle(policy)
        self._drop_unneeded()

    def required(self, sequence: int) -> PublishedPolicy | Wait:
        """The weights that must act on a trajectory, or what to wait for."""
        lag = self.learner.policy_lag
        oldest = self._started_at - max(0, lag - (sequence - self._first))
        for policy in self._policies:
            if policy.snapshot.version >= oldest and self._accounted(policy) >= sequence - lag:
                return policy
        return Wait(
            f"weights that account for trajectories before {sequence - lag}, of version "
            f"{max(0, oldest)} or later"
        )

    def use(self, policy: PublishedPolicy) -> None:
        """These weights act from now on, and older ones never again."""
        first = policy.snapshot.version
        later = [one for one in self._policies if one.snapshot.version >= first]
        self._policies = later or [policy]

    def overdue(self, waited: bool) -> list[Trajectory]:
        """Messages to send again; call once per resend period.

        `waited`: the agent waited that long for weights, so perhaps nobody received what it sent.
        """
        return self.unaccounted if waited else []

    @property
    def _held_from(self) -> int:
        return self._sent[0].sequence if self._sent else self._next

    def _as_held(self, trajectory: Trajectory) -> Trajectory:
        return replace(trajectory, held_from=self._held_from, first_of_run=self._first)

    def _accounted(self, policy: PublishedPolicy) -> int:
        """By these weights, trajectories before this number were learned from, rejected or given
        up."""
        return max(policy.accounted.get(self._agent, 0), self._given_up)

    def _drop_unneeded(self) -> None:
        """Drop weights that can never be required.

        Of versions that account for equally many trajectories only the first ever acts. An agent
        whose arm is paused beside others that learn would otherwise keep every version.
        """
        kept = self._policies[:1]
        for one in self._policies[1:]:
            early = kept[-1].snapshot.version < self._started_at
            if early or self._accounted(one) != self._accounted(kept[-1]):
                kept.append(one)
        self._policies = kept

    def _settle(self, newest: PublishedPolicy) -> None:
        """Forget trajectories that these weights account for, and give up those that are lost."""
        accounted = self._accounted(newest)
        self.overtaken = accounted > self._next
        self._sent = [one for one in self._sent if one.sequence >= accounted]
        if accounted < self._held_from:
            self.lost += self._held_from - accounted
            self._given_up = self._held_from
            self.use(newest)


class FreeSendWindow(SendWindow):
    """The rule of an agent that never waits: the newest weights act, however old they are.

    It keeps the newest FREE_WINDOW trajectories that the learner has not accepted, and offers them
    again, a few at a time, while the learner makes no progress. Older ones are lost and counted.
    """

    def __init__(self, agent: AgentKey, first_sequence: int, learner: LearnerInfo) -> None:
        super().__init__(agent, first_sequence, learner)
        self._oldest_before = -1  # oldest unaccounted trajectory, one resend period ago

    def add(self, trajectory: Trajectory) -> Trajectory:
        super().add(trajectory)
        if len(self._sent) > FREE_WINDOW:
            del self._sent[0]
            self.lost += 1
            self._given_up = self._held_from
        return self._as_held(trajectory)

    def resume(self, learner: LearnerInfo) -> None:
        self.learner = learner

    def receive(self, policy: PublishedPolicy) -> None:
        newest = self._policies[0] if self._policies else policy
        same = newest.learner_id == policy.learner_id
        if not same or policy.snapshot.version >= newest.snapshot.version:
            self._policies = [policy]
            self._settle(policy)

    def required(self, sequence: int) -> PublishedPolicy | Wait:
        return self._policies[0] if self._policies else Wait("the learner's first weights")

    def overdue(self, waited: bool) -> list[Trajectory]:
        oldest = self._held_from if self._sent else -1
        self.stalled = oldest >= 0 and oldest == self._oldest_before
        self._oldest_before = oldest
        return self.unaccounted[:RESENT_AT_ONCE] if self.stalled else []
