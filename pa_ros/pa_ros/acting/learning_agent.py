"""An agent that learns: it explores, and sends trajectories, as its learner asks."""

from __future__ import annotations

from dataclasses import replace

from pa_ros.acting.account import Account, FreeAccount
from pa_ros.acting.actor import Actor
from pa_ros.acting.agent import Agent, Step
from pa_ros.acting.answer import Act, Answer, Wait
from pa_ros.acting.errors import ActingError
from pa_ros.acting.exploration import ExplorationNoise
from pa_ros.acting.requests import ArenaFacts, check_arena, exploration_of, network_of
from pa_ros.acting.trajectories import TrajectoryBuilder
from pa_ros.core.errors import PaError
from pa_ros.core.experience import AgentKey, Float32
from pa_ros.core.published import LearnerInfo, PublishedPolicy
from pa_ros.language import PRODUCT
from pa_ros.world import Trajectory


class LearningAgent(Agent):
    """At each step `observe`, send the trajectory it returns, `load` what `answer` says, and `act`.

    The order matters and is the same over the graph and in process: a trajectory that ends at an
    observation is sent before the action at that observation is chosen. In evaluation episodes it
    is greedy and silent.
    """

    def __init__(self, key: AgentKey, seed: int, first_sequence: int = 0) -> None:
        """`seed`: of the exploration noise. `first_sequence`: of the first trajectory."""
        super().__init__(key, PRODUCT)
        self.interrupted = 0  # runs of steps broken off: not as commanded, or for another learner
        self.overtaken = 0  # times that someone else sent trajectories under this agent's name
        self._seed, self._first_sequence = seed, first_sequence
        self._account: Account | None = None
        self._builder: TrajectoryBuilder | None = None
        self._past: set[str] = set()  # learners that were followed

    @property
    def lost(self) -> int:
        """Trajectories of this run that its learner has lost, and the agent no longer holds."""
        return 0 if self._account is None else self._account.lost

    @property
    def unaccounted(self) -> list[Trajectory]:
        """What was sent and may have to be sent again."""
        return [] if self._account is None else self._account.unaccounted

    @property
    def stalled(self) -> bool:
        """Whether its learner takes in nothing, though it acts on."""
        return self._account is not None and self._account.stalled

    def overdue(self, late: bool) -> list[Trajectory]:
        """Asked once a resend period: what is to be sent again. `late`: no command was sent for as
        long."""
        return [] if self._account is None else self._account.overdue(late and self.waiting)

    def follow(self, learner: LearnerInfo, arena: ArenaFacts) -> None:
        """Act for this learner in this arena, and for the one followed until now no more.

        Raises ActingError, and then does not act, if it cannot do as the learner asks.
        """
        current = None if self._account is None else self._account.learner
        other = current is not None and current.learner_id != learner.learner_id
        try:
            check_arena(learner, arena)
            if current is None or not _goes_on(current, learner):
                self._begin(learner)
            elif self._account is not None and other:
                self._account.resume(learner)
        except PaError as error:
            if not other:
                self.refusal = str(error)
            raise
        self.refusal = ""
        if current is not None and other:
            self._past.add(current.learner_id)
        self._past.discard(learner.learner_id)
        self._offer_early(learner)

    def offer(self, policy: PublishedPolicy) -> None:
        """Weights have come. Raises ActingError if they cannot be used, or are not the learner's
        that this agent follows."""
        if self._account is None or policy.learner_id != self._account.learner.learner_id:
            self._keep(policy)
            if policy.learner_id in self._past:
                raise ActingError(
                    f"policy: expected one of the learner that is followed, got version "
                    f"{policy.snapshot.version} of {policy.learner_id!r}, which was before",
                )
        else:
            self._take(policy)
            if self._account.overtaken:
                self._live_again(self._account, policy)

    def observe(self, step: Step) -> Trajectory | None:
        verdict = step.verdict
        truncated = verdict is not None and verdict.truncated
        super().observe(replace(step, ends_episode=step.ends_episode or truncated))
        if self._builder is None or self._account is None or step.evaluation:
            return None
        if verdict is None:
            raise ActingError(
                "step: expected a verdict, since this agent learns, got none", code="learning.step"
            )
        goes_on = step.observation.step > 0 and not self._builder.at_boundary
        if goes_on and (step.executed is None or step.executed != self.sent):
            self._builder = self._break_off(self._account.learner)
        trajectory = self._builder.observe(step.observation, verdict, step.program)
        return None if trajectory is None else self._account.send(trajectory)

    def answer(self) -> Answer:
        if self.refusal:
            return Wait(f"another learner or arena: {self.refusal}")
        if self._builder is None:
            return Wait("a learner to announce itself")
        if self.waiting and not self._builder.at_boundary:
            return Act()
        return self._answer(self._builder.sequence)

    def _action(self, actor: Actor, step: Step) -> Float32:
        if step.evaluation or self._builder is None:
            return super()._action(actor, step)
        action = actor.explore(step.observation, step.program)
        self._builder.acted(action, actor.version)
        return action

    def _begin(self, learner: LearnerInfo) -> None:
        """Another run: an account of its own, with numbers that go on, and nothing carried over."""
        network, period = network_of(learner), learner.control_period
        actions = network.world.actions
        noise = ExplorationNoise(exploration_of(learner), period, self._seed, actions)
        actor = Actor(network, learner.inference, noise, self.logic)
        self._actor, self._loaded = actor, None
        builder, step = self._break_off(learner), self._step
        rule = FreeAccount if learner.free else Account
        self._account = self._rule = rule(self.key, builder.sequence, learner)
        if step is not None and step.verdict is not None and not step.evaluation:
            builder.observe(step.observation, step.verdict, step.program)

    def _live_again(self, account: Account, policy: PublishedPolicy) -> None:
        """Go on as another incarnation, whose account is its own: the learner takes what this one
        sends for what it already has."""
        self.overtaken += 1
        self.key = AgentKey(self.key.agent_id, self.key.incarnation + 1)
        self._begin(account.learner)
        self._take(policy)

    def _break_off(self, learner: LearnerInfo) -> TrajectoryBuilder:
        """Begin a trajectory at the next step, whatever was collected."""
        before = self._builder
        if before is not None and not before.at_boundary:
            self.interrupted += 1
        self._builder = TrajectoryBuilder(
            self.key,
            learner.run_id,
            learner.trajectory_steps,
            network_of(learner).world,
            self._first_sequence if before is None else before.sequence,
        )
        return self._builder


def _goes_on(current: LearnerInfo, learner: LearnerInfo) -> bool:
    """Whether it is the same run, and asks the same."""
    of_the_start = ("learner_id", "first_version", "stamp_ns", "software_version")
    same = {name: getattr(learner, name) for name in of_the_start}
    return replace(current, **same) == learner
