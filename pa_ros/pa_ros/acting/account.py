"""Which weights may act: the rules of docs/DESIGN.md, "The synchronous protocol", for an agent."""

from __future__ import annotations

from dataclasses import replace

from pa_ros.acting.answer import Wait
from pa_ros.core.experience import AgentKey
from pa_ros.core.published import LearnerInfo, PublishedPolicy
from pa_ros.world import Trajectory

KEPT = 64  # trajectories that a free agent keeps for a learner that takes in nothing
RESENT = 4  # of these at a time


class Newest:
    """The rule of a greedy agent: the newest weights, whoever published them."""

    def __init__(self) -> None:
        self._policies: list[PublishedPolicy] = []

    def receive(self, policy: PublishedPolicy) -> None:
        """Weights have come."""
        self._policies = [policy]

    def required(self, sequence: int) -> PublishedPolicy | Wait:
        """The weights that must act now, or what must be waited for."""
        return self._policies[0] if self._policies else Wait("weights: none have come")

    def use(self, policy: PublishedPolicy) -> None:
        """These weights act from now on."""


class Account:
    """The rule of a learning agent, and its account with one learner's run.

    Trajectory m is acted by the first weights that account for all trajectories before
    m − policy_lag. The first ones, for which that says nothing, are acted as if the versions up to
    the learner's start had been this agent's own: so a run that was resumed goes on as if unbroken.

    What was sent is kept until weights account for it. What the learner has lost beyond that
    (it was killed, and resumed from before) is given up: trajectories say from where on they are
    held, so that neither side waits for it.
    """

    def __init__(self, agent: AgentKey, begins: int, learner: LearnerInfo) -> None:
        """`begins`: the sequence number of the first trajectory for this run."""
        self.learner = learner
        self.lost = 0  # trajectories given up
        self.overtaken = False  # the learner has trajectories of this agent that it never sent
        self._agent = agent
        self._begins = self._next = self._given_up = begins
        self._started_at = learner.first_version
        self._sent: list[Trajectory] = []  # not accounted for yet
        self._policies: list[PublishedPolicy] = []  # that may still have to act, oldest first

    @property
    def unaccounted(self) -> list[Trajectory]:
        """What was sent and may have to be sent again, as it is to be sent."""
        return [self._as_held(trajectory) for trajectory in self._sent]

    def send(self, trajectory: Trajectory) -> Trajectory:
        """Keep the next trajectory until it is accounted for; as it is to be sent."""
        self._sent.append(trajectory)
        self._next = trajectory.sequence + 1
        return self._as_held(trajectory)

    def resume(self, learner: LearnerInfo) -> None:
        """The run goes on with another learner, which knows nothing after its first version."""
        self.learner = learner
        last = learner.first_version
        self._policies = [one for one in self._policies if one.snapshot.version <= last]

    def receive(self, policy: PublishedPolicy) -> None:
        """Weights of this learner have come; of one version the latest counts."""
        version = policy.snapshot.version
        others = [one for one in self._policies if one.snapshot.version != version]
        if others and version < others[0].snapshot.version:
            return  # from before its start: newer ones are in use
        self._policies = sorted([*others, policy], key=lambda one: one.snapshot.version)
        if version >= self.learner.first_version:
            self._settle(policy)
        self._drop_idle()

    def required(self, sequence: int) -> PublishedPolicy | Wait:
        """The weights that must act on a trajectory, or what must be waited for."""
        lag = self.learner.policy_lag
        oldest = self._started_at - max(0, lag - (sequence - self._begins))
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
        """Asked once a resend period: what is to be sent again. `waited`: that long, for weights
        that account for it; perhaps nobody heard it."""
        return self.unaccounted if waited else []

    @property
    def stalled(self) -> bool:
        """Whether the learner takes in nothing, though nobody waits for it."""
        return False

    @property
    def _held_from(self) -> int:
        return self._sent[0].sequence if self._sent else self._next

    def _as_held(self, trajectory: Trajectory) -> Trajectory:
        return replace(trajectory, held_from=self._held_from)

    def _accounted(self, policy: PublishedPolicy) -> int:
        """All trajectories before this one are waited for no more, once these weights are here."""
        return max(policy.accounted.get(self._agent, 0), self._given_up)

    def _drop_idle(self) -> None:
        """Weights that others before them, accounting for as much, will always act in place of: an
        agent whose arm stands, beside others that learn, would keep every version."""
        kept = self._policies[:1]
        for one in self._policies[1:]:
            early = kept[-1].snapshot.version < self._started_at
            if early or self._accounted(one) != self._accounted(kept[-1]):
                kept.append(one)
        self._policies = kept

    def _settle(self, newest: PublishedPolicy) -> None:
        accounted = self._accounted(newest)
        self.overtaken = accounted > self._next
        self._sent = [one for one in self._sent if one.sequence >= accounted]
        if accounted < self._held_from:
            self.lost += self._held_from - accounted
            self._given_up = self._held_from
            self.use(newest)


class FreeAccount(Account):
    """The account of an agent that never waits: the newest weights act, however old.

    What the learner has not taken in is kept, the newest KEPT of it, and offered again a few at a
    time while the learner's account stands still; what goes beyond that is lost, and counted.
    """

    def __init__(self, agent: AgentKey, begins: int, learner: LearnerInfo) -> None:
        super().__init__(agent, begins, learner)
        self._first_asked = -1  # the first not accounted for when it was asked last
        self._stalled = False

    @property
    def stalled(self) -> bool:
        return self._stalled

    def send(self, trajectory: Trajectory) -> Trajectory:
        self._sent.append(trajectory)
        self._next = trajectory.sequence + 1
        if len(self._sent) > KEPT:
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
        first = self._held_from if self._sent else -1
        self._stalled = first >= 0 and first == self._first_asked
        self._first_asked = first
        return self.unaccounted[:RESENT] if self._stalled else []
