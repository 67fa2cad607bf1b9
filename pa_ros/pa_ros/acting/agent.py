"""An agent at its control steps, over the graph as in process."""

from __future__ import annotations

from collections import OrderedDict, deque
from dataclasses import dataclass
from itertools import count

import numpy as np

from pa_ros.acting.account import Account, Newest
from pa_ros.acting.actor import Actor
from pa_ros.acting.answer import Act, Answer, Load, Wait
from pa_ros.acting.errors import ActingError
from pa_ros.acting.requests import ArenaFacts, check_words, network_of
from pa_ros.core.experience import (
    AgentKey,
    CommandKey,
    Executed,
    Float32,
    Observation,
    Verdict,
)
from pa_ros.core.published import LearnerInfo, PublishedPolicy
from pa_ros.language import MIN_MAX, Logic, Program
from pa_ros.world import Trajectory
from pa_ros.world.world import World


@dataclass(frozen=True, slots=True)
class Step:
    """One control step."""

    observation: Observation
    program: Program  # that the observation's program id stands for
    verdict: Verdict | None = None  # None: a greedy agent needs none
    evaluation: bool = False  # to be acted on greedily, and no experience
    executed: Executed | None = None  # the command that, unaltered, led here
    ends_episode: bool = False  # nothing is to be done about it any more


MAY_ACT = Act()
EARLY_LEARNERS, EARLY_POLICIES = 4, 4  # kept of learners that may come to be followed


class Agent:
    """A greedy agent: at each step `observe`, `load` what `answer` says, and `act`.

    Until a learner has announced itself, the architecture of the first weights counts. Soft truths
    are joined by `logic`.
    """

    def __init__(self, key: AgentKey, logic: Logic = MIN_MAX) -> None:
        self.key, self.logic = key, logic
        self.refusal = ""  # why it does not act for the learner; empty: it does
        self._learner: LearnerInfo | None = None  # whose weights alone are used; None: anyone's
        self._early: OrderedDict[str, deque[PublishedPolicy]] = OrderedDict()  # by learner
        self.sent: Executed | None = None  # the newest command, as it is when carried out
        self._numbers = count(1)
        self._rule: Newest | Account = Newest()
        self._actor: Actor | None = None
        self._loaded: PublishedPolicy | None = None
        self._step: Step | None = None  # to be acted on

    @property
    def waiting(self) -> bool:
        """Whether a step is still to be acted on."""
        return self._step is not None

    @property
    def has_weights(self) -> bool:
        """Whether weights are in use or, before the first step, at hand for it."""
        return not isinstance(self._at_hand(), Wait)

    @property
    def version(self) -> int:
        """Of those weights. ActingError if there are none."""
        policy = self._at_hand()
        if isinstance(policy, Wait):
            raise ActingError(
                f"version: expected weights before it is asked, got {policy}", code="learning.step"
            )
        return policy.snapshot.version

    def follow(self, learner: LearnerInfo, arena: ArenaFacts) -> None:
        """Act with this learner's weights alone.

        Those in use act until its own have come. Raises ActingError, and changes nothing,
        if its weights cannot act in this arena.
        """
        check_words(learner, arena)
        network_of(learner)
        self._learner = learner
        self._offer_early(learner)

    def check_program(self, program: Program) -> None:
        """Raise NetworkError or ProgramError if the weights at hand cannot be told
        this program."""
        if self._actor is not None:
            network = self._actor.network
            network.family.check(program, network.vocabulary)

    def check_world(self, world: World) -> None:
        """Raise ActingError if the weights at hand see other objects, or another arm."""
        ours = self._actor.network.world if self._actor is not None else world
        if ours.object_features != world.object_features:
            raise ActingError(
                f"policy: expected {ours.object_features} features of an object, "
                f"got {world.object_features}",
            )
        if ours.joints != world.joints:
            raise ActingError(
                f"policy: expected an arm of {ours.joints} joints, got {world.joints}",
            )

    def offer(self, policy: PublishedPolicy) -> None:
        """Weights have come. Raises ActingError, and changes nothing, if they cannot be used."""
        try:
            self._take(policy)
        except ActingError:
            self._keep(policy)  # their learner may come to be followed
            raise

    def _take(self, policy: PublishedPolicy) -> None:
        learner, actor = self._learner, self._actor
        if learner is not None and learner.learner_id != policy.learner_id:
            raise ActingError(
                f"policy: expected weights of the learner that is followed, "
                f"{learner.learner_id!r}, got version {policy.snapshot.version} of "
                f"{policy.learner_id!r}",
            )
        if learner is not None and (
            actor is None or actor.network.architecture != learner.architecture
        ):
            actor = Actor(network_of(learner), learner.inference, logic=self.logic)
        actor = actor or Actor.fitting(policy.snapshot, self.logic)
        actor.check(policy.snapshot)
        if actor is not self._actor:
            self._actor, self._loaded = actor, None
        self._rule.receive(policy)

    def _offer_early(self, learner: LearnerInfo) -> None:
        for policy in self._early.pop(learner.learner_id, ()):
            self.offer(policy)

    def _keep(self, policy: PublishedPolicy) -> None:
        """Weights of a learner that is not followed."""
        kept = self._early.setdefault(policy.learner_id, deque(maxlen=EARLY_POLICIES))
        kept.append(policy)
        self._early.move_to_end(policy.learner_id)
        while len(self._early) > EARLY_LEARNERS:
            self._early.popitem(last=False)

    def observe(self, step: Step) -> Trajectory | None:
        """Take in a step; the trajectory to be sent, if that completed one."""
        self._step = None if step.ends_episode else step
        return None

    def answer(self) -> Answer:
        """Whether the agent may act on the step observed last, and with which weights."""
        return self._answer(0)

    def load(self, policy: PublishedPolicy) -> None:
        """Act with these weights from here on."""
        if self._actor is None:
            raise ActingError(
                "weights: expected an offer of them before they are loaded", code="learning.step"
            )
        self._actor.load(policy.snapshot)
        self._loaded = policy
        self._rule.use(policy)

    def act(self) -> Float32:
        """The action at the step observed last, [J] in [-1, 1]. ActingError unless it may act."""
        answer, step, actor = self.answer(), self._step, self._actor
        if step is None or actor is None or not isinstance(answer, Act):
            raise ActingError(
                f"action: expected the answer {Act()} before it, got {answer}", code="learning.step"
            )
        action = self._action(actor, step)
        self._step = None
        return self._send(action)

    def hold(self) -> Float32:
        """Instead of `act`: the command that keeps the arm where it is, [J]; no experience.

        ActingError without a step to hold at.
        """
        if self._step is None:
            raise ActingError(
                "action: expected an observation before it, got none", code="learning.step"
            )
        joints = len(self._step.observation.joint_position)
        self._step = None
        return self._send(np.zeros(joints, np.float32))

    def _send(self, action: Float32) -> Float32:
        """Number a command, and remember it."""
        self.sent = Executed(CommandKey(*self.key, next(self._numbers)), action)
        return action

    @property
    def backend(self) -> str:
        """What computes its actions: "fused" or "torch"; empty: it cannot act yet."""
        return self._actor.backend if self._actor is not None else ""

    def relevance(self, observation: Observation, program: Program) -> tuple[float, ...]:
        """p of each object, as far as the weights in use have degrees; else empty."""
        return self._actor.relevance(observation, program) if self._actor is not None else ()

    def _at_hand(self) -> PublishedPolicy | Wait:
        return self._loaded or self._rule.required(0)

    def _answer(self, sequence: int) -> Answer:
        if self._step is None:
            return Wait("a step to act on")
        required = self._rule.required(sequence)
        if isinstance(required, Wait):
            return required
        loaded = self._loaded
        same = loaded is required or (loaded is not None and loaded.name == required.name)
        return MAY_ACT if same else Load(required)

    def _action(self, actor: Actor, step: Step) -> Float32:
        return actor.act(step.observation, step.program)
