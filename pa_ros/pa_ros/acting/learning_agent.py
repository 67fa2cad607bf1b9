"""An agent that learns: it explores, and sends trajectories as its learner asks."""

from __future__ import annotations

from dataclasses import replace

from pa_ros.acting.agent import Agent, ArenaFacts, check_arena, network_of
from pa_ros.acting.config import ExplorationConfig
from pa_ros.acting.errors import ActingError
from pa_ros.acting.executing import Actor
from pa_ros.acting.exploration import ExplorationNoise
from pa_ros.acting.send_window import FreeSendWindow, SendWindow, Wait
from pa_ros.acting.trajectories import TrajectoryBuilder
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.experience import (
    AgentKey,
    Executed,
    Float32,
    LearnerInfo,
    Observation,
    PublishedPolicy,
    Step,
)
from pa_ros.language import PRODUCT, Goal, Program
from pa_ros.language.parser import over_time
from pa_ros.world import Trajectory


class LearningAgent(Agent):
    """At each step: `observe`, send the trajectory it returns, `prepare`, then `act`.

    The order matters and is the same over the graph and in one process: a trajectory that ends at
    an observation is sent before the action at that observation is chosen. Evaluation episodes are
    acted greedily and send nothing.
    """

    def __init__(self, key: AgentKey, seed: int, first_sequence: int = 0) -> None:
        """`seed`: of the exploration noise. `first_sequence`: number of the first trajectory."""
        super().__init__(key, PRODUCT)
        self.interrupted = 0  # trajectories cut short: not as commanded, or for another learner
        self._seed, self._first_sequence = seed, first_sequence
        self._window: SendWindow | None = None
        self._builder: TrajectoryBuilder | None = None
        self._acted_on: Observation | None = None  # with exploration, last

    @property
    def lost(self) -> int:
        """Trajectories of this run that the learner lost and the agent no longer holds."""
        return 0 if self._window is None else self._window.lost

    @property
    def unaccounted(self) -> list[Trajectory]:
        """Trajectories that were sent and may have to be sent again."""
        return [] if self._window is None else self._window.unaccounted

    @property
    def stalled(self) -> bool:
        """Whether the learner accepts nothing although the agent acts on without waiting."""
        return self._window is not None and self._window.stalled

    def overdue(self, late: bool) -> list[Trajectory]:
        """Messages to send again; call once per resend period. `late`: no command was sent."""
        return [] if self._window is None else self._window.overdue(late and self.waiting)

    def follow(self, learner: LearnerInfo, arena: ArenaFacts) -> None:
        """Act for this learner in this arena, and no longer for the one followed until now.

        Raises ActingError if it cannot do as the learner asks. Then it keeps the learner it
        already follows; if that one's request changed, it stops acting.
        """
        current = None if self._window is None else self._window.learner
        other = current is not None and current.learner_id != learner.learner_id
        try:
            check_arena(learner, arena)
            if self._window is None or not _same_run(self._window.learner, learner):
                self._begin(learner)
            elif other:
                self._window.resume(learner)
        except PaError as error:
            if not other:
                self.rejection = str(error)
            raise
        self.rejection = ""
        self._offer_kept(learner)

    def offer(self, policy: PublishedPolicy) -> None:
        """Take in published weights; ActingError if they do not fit.

        Another learner's are kept: it may be followed next.
        """
        if self._window is None or policy.learner_id != self._window.learner.learner_id:
            self._kept.append(policy)
            return
        self._receive(policy)
        if self._window.overtaken:  # its numbers are used up: continue as a new incarnation
            self.key = AgentKey(self.key.agent_id, self.key.incarnation + 1)
            self._begin(self._window.learner)
            self._receive(policy)

    def check_program(self, goal: Goal) -> None:
        if not isinstance(goal, Program):
            raise over_time(goal, str(goal))
        super().check_program(goal)

    def observe(self, step: Step, goal: Goal) -> Trajectory | None:
        if step.verdict is None and not step.evaluation:
            raise ActingError(
                "object_features: expected steps that a verifier judged, since this agent learns, "
                "got one without a reward",
                code="learning.unjudged",
            )
        super().observe(step, goal)
        if self._builder is None or self._window is None or step.evaluation:
            return None
        if not isinstance(goal, Program):  # `act` refuses it
            self._builder = self._new_builder(self._window.learner)
            return None
        # A transition is true only with the action that the arm had from this agent's command on.
        if step.observation.step > 0 and not self._builder.at_boundary:
            self._note_applied(self._builder, step.executed)
        assert step.verdict is not None
        trajectory = self._builder.observe(step.observation, step.verdict, goal)
        return None if trajectory is None else self._window.add(trajectory)

    def _note_applied(self, builder: TrajectoryBuilder, executed: Executed | None) -> None:
        """Record what the arm did with the last command."""
        sent, before = self.last_command, self._acted_on
        if executed is None or sent is None or not executed.answers(sent):
            self.interrupted += 1
            builder.applied(None)
        elif executed.action.tobytes() != sent.action.tobytes() and self._actor and before:
            world = self._actor.network.world
            builder.applied(world.action_of(executed.action, before.joint_position))

    def pursued(self, step: Step, goal: Goal) -> Program:
        """The goal itself: rewards of a goal over time are not those of its programs."""
        if isinstance(goal, Program):
            return goal
        raise over_time(goal, str(goal))

    def required(self) -> PublishedPolicy | Wait:
        if self.rejection:
            return Wait(f"another learner or arena: {self.rejection}")
        if self._builder is None:
            return Wait("a learner to announce itself")
        if self._step is None:
            return Wait("a step to act on")
        if not self._builder.at_boundary and self._loaded is not None:
            return self._loaded  # weights change only between trajectories
        assert self._window is not None
        return self._window.required(self._builder.sequence)

    def _receive(self, policy: PublishedPolicy) -> None:
        super()._receive(policy)
        assert self._window is not None  # `offer` keeps weights that arrive before
        self._window.receive(policy)

    def _load(self, policy: PublishedPolicy) -> None:
        super()._load(policy)
        assert self._window is not None
        self._window.use(policy)

    def _action(self, actor: Actor, step: Step, program: Program) -> Float32:
        if step.evaluation or self._builder is None:
            return super()._action(actor, step, program)
        action = actor.explore(step.observation, program)
        self._builder.acted(action, actor.version)
        self._acted_on = step.observation
        return action

    def _begin(self, learner: LearnerInfo) -> None:
        """Begin with another run: a new window, continued numbers, and nothing carried over."""
        network, period = network_of(learner), learner.control_period
        noise = ExplorationNoise(
            _exploration_of(learner), period, self._seed, network.world.actions
        )
        self._actor, self._loaded = Actor(network, learner.inference, noise, self.logic), None
        self._newest = None
        builder = self._new_builder(learner)
        window = FreeSendWindow if learner.free else SendWindow
        self._window = window(self.key, builder.sequence, learner)
        if self._step is not None:
            step, goal = self._step
            if step.verdict is not None and not step.evaluation and isinstance(goal, Program):
                builder.observe(step.observation, step.verdict, goal)

    def _new_builder(self, learner: LearnerInfo) -> TrajectoryBuilder:
        """Begin a trajectory at the next step and drop what was collected."""
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


def _exploration_of(learner: LearnerInfo) -> ExplorationConfig:
    try:
        return ExplorationConfig.from_json(learner.exploration)
    except ConfigError as error:
        raise ActingError(f"learner_info.exploration: {error}", code="learner.request") from error


def _same_run(current: LearnerInfo, learner: LearnerInfo) -> bool:
    """Whether a learner continues the current run and asks the same of its agents."""
    of_this_start = ("learner_id", "first_version", "stamp_ns", "software_version")
    same = {name: getattr(learner, name) for name in of_this_start}
    return replace(current, **same) == learner
