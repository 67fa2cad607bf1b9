"""An agent at its control steps, over the graph as in process."""

from __future__ import annotations

from dataclasses import dataclass

from pa_ros.acting.account import Account, Newest
from pa_ros.acting.actor import Actor
from pa_ros.acting.answer import Act, Answer, Load, Wait
from pa_ros.acting.errors import StepError
from pa_ros.core.experience import AgentKey, Float32, Observation, Verdict
from pa_ros.core.published import PublishedPolicy
from pa_ros.language import Program
from pa_ros.world import Trajectory


@dataclass(frozen=True, slots=True)
class Step:
    """One control step."""

    observation: Observation
    program: Program  # that the observation's program id stands for
    verdict: Verdict | None = None  # None: a greedy agent needs none
    evaluation: bool = False  # to be acted on greedily, and no experience
    commanded_by: str = ""  # whose command, unaltered, led here
    ends_episode: bool = False  # nothing is to be done about it any more


class Agent:
    """A greedy agent: at each step `observe`, `load` what `answer` says, and `act`."""

    def __init__(self, key: AgentKey) -> None:
        self.key = key
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
        """Of those weights. StepError if there are none."""
        policy = self._at_hand()
        if isinstance(policy, Wait):
            raise StepError(f"version: expected weights before it is asked, got {policy}")
        return policy.snapshot.version

    def offer(self, policy: PublishedPolicy) -> None:
        """Weights have come. Raises PolicyError, and changes nothing, if they cannot be used."""
        actor = self._actor or Actor.fitting(policy.snapshot)
        actor.check(policy.snapshot)
        self._actor = actor
        self._rule.receive(policy)

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
            raise StepError("weights: expected an offer of them before they are loaded")
        self._actor.load(policy.snapshot)
        self._loaded = policy
        self._rule.use(policy)

    def act(self) -> Float32:
        """The action at the step observed last, [6] in [-1, 1]. StepError unless it may act."""
        answer, step, actor = self.answer(), self._step, self._actor
        if step is None or actor is None or not isinstance(answer, Act):
            raise StepError(f"action: expected the answer {Act()} before it, got {answer}")
        self._step = None
        return self._action(actor, step)

    def _at_hand(self) -> PublishedPolicy | Wait:
        return self._loaded or self._rule.required(0)

    def _answer(self, sequence: int) -> Answer:
        if self._step is None:
            return Wait("a step to act on")
        required = self._rule.required(sequence)
        if isinstance(required, Wait):
            return required
        loaded = self._loaded
        return Act() if loaded is not None and loaded.name == required.name else Load(required)

    def _action(self, actor: Actor, step: Step) -> Float32:
        return actor.act(step.observation, step.program)
