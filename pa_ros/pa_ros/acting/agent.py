"""An agent at its control steps: the same object acts over the graph and in one process."""

from __future__ import annotations

from collections import deque
from itertools import count
from typing import NamedTuple

import numpy as np

from pa_ros.acting.errors import ActingError
from pa_ros.acting.executing import Actor
from pa_ros.acting.send_window import Wait
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import (
    AgentKey,
    CommandKey,
    Executed,
    Float32,
    LearnerInfo,
    PublishedPolicy,
    Step,
    Verdict,
)
from pa_ros.language import MIN_MAX, Goal, Logic, Program, stages
from pa_ros.networks.config import NetworkConfig, actor_config
from pa_ros.networks.families import check_goal, family_of
from pa_ros.world import Scoring, Trajectory
from pa_ros.world.progress import GoalWatch
from pa_ros.world.schema import Seen
from pa_ros.world.world import World

KEPT_POLICIES = 16  # of learners that may be followed later


class ArenaFacts(NamedTuple):
    """Facts about an arena that its learner must agree with: fields of LearnerInfo."""

    world_digest: str
    control_period: float  # s
    thresholds: tuple[float, ...]  # of the world's relations
    reward: str  # canonical JSON: name and parameters


class Agent:
    """A greedy agent. At each step: `observe`, then `prepare`; when that returns None, `act`.

    Until it follows a learner, the first weights decide the architecture. `logic` says what AND and
    OR of degrees are.
    """

    def __init__(self, key: AgentKey, logic: Logic = MIN_MAX) -> None:
        self.key, self.logic = key, logic
        self.rejection = ""  # why it does not act for the learner; empty: it does
        self.last_command: Executed | None = None
        self._learner: LearnerInfo | None = None  # only its weights are used; None: anyone's
        self._kept: deque[PublishedPolicy] = deque(maxlen=KEPT_POLICIES)
        self._numbers = count(1)
        self._actor: Actor | None = None
        self._newest: PublishedPolicy | None = None  # of those that fit
        self._loaded: PublishedPolicy | None = None
        self._step: tuple[Step, Goal] | None = None  # still to be acted on
        self._own: OwnJudgement | None = None  # of the goal in force, where no verifier is heard
        self.scoring: Scoring | None = None  # the arena's; None: of the relations' own thresholds
        self._ready = False  # `prepare` loaded the weights that must act on this step

    @property
    def waiting(self) -> bool:
        """Whether a step is still to be acted on."""
        return self._step is not None

    @property
    def has_weights(self) -> bool:
        """Whether weights are in use or, before the first step, ready for it."""
        return self._loaded is not None or self._newest is not None

    @property
    def version(self) -> int:
        """Version of those weights. ActingError if there are none."""
        policy = self._loaded or self._newest
        if policy is None:
            raise ActingError("version: expected weights before it is asked, got none")
        return policy.snapshot.version

    @property
    def backend(self) -> str:
        """The code that computes actions, "fused" or "torch"; empty before weights arrive."""
        return self._actor.backend if self._actor is not None else ""

    # The learner and its weights

    def follow(self, learner: LearnerInfo, arena: ArenaFacts) -> None:
        """Use this learner's weights only, once they arrive; until then the current ones act.

        Raises ActingError, and changes nothing, if its weights cannot act in this arena.
        """
        _check_fact(learner, arena, "world_digest")
        network_of(learner)
        self._learner = learner
        self._offer_kept(learner)

    def offer(self, policy: PublishedPolicy) -> None:
        """Take in published weights. Raises ActingError, and changes nothing, if they do not fit.

        Rejected weights are kept for a while: their learner may be followed later. Learner and
        weights arrive on two topics, in any order.
        """
        try:
            self._receive(policy)
        except ActingError:
            self._kept.append(policy)
            raise

    def _receive(self, policy: PublishedPolicy) -> None:
        learner, actor = self._learner, self._actor
        if learner is not None and learner.learner_id != policy.learner_id:
            raise ActingError(
                f"policy: expected weights of the learner that is followed, "
                f"{learner.learner_id!r}, got version {policy.snapshot.version} of "
                f"{policy.learner_id!r}"
            )
        if learner is not None and (
            actor is None or actor.network.architecture != learner.architecture
        ):
            actor = Actor(network_of(learner), learner.inference, logic=self.logic)
        actor = actor or Actor.fitting(policy.snapshot, self.logic)
        actor.check(policy.snapshot)
        if actor is not self._actor:
            self._actor, self._loaded = actor, None
        self._newest = policy

    def _offer_kept(self, learner: LearnerInfo) -> None:
        wanted = [one for one in self._kept if one.learner_id == learner.learner_id]
        others = [one for one in self._kept if one.learner_id != learner.learner_id]
        self._kept = deque(others, maxlen=KEPT_POLICIES)
        for policy in wanted:
            self.offer(policy)

    def check_program(self, goal: Goal) -> None:
        """Raise NetworkError or ProgramError if the weights cannot represent a program of it."""
        if self._actor is not None:
            check_goal(self._actor.network, goal)

    def check_world(self, world: World) -> None:
        """Raise ActingError if the weights expect other objects, or another arm."""
        ours = self._actor.network.world if self._actor is not None else world
        if ours.object_features != world.object_features:
            raise ActingError(
                f"policy: expected {ours.object_features} features of an object, "
                f"got {world.object_features}"
            )
        looks, seen = (
            [g.features for g in w.schema if isinstance(g.features, Seen)] for w in (ours, world)
        )
        if looks != seen:
            raise ActingError(
                "policy: expected properties seen with the camera's calibration that it learned "
                f"with, got {seen}: name the agent's checkpoint in the arena's perception"
            )
        if ours.joints != world.joints:
            raise ActingError(
                f"policy: expected an arm of {ours.joints} joints, got {world.joints}"
            )

    # One control step

    def observe(self, step: Step, goal: Goal) -> Trajectory | None:
        """Take in a step, and the goal that its text names.

        Returns the trajectory that it completed, to be sent, if any. Raises ActingError for a
        stage that the goal lacks.
        """
        stage, count = step.verdict.stage if step.verdict else 0, len(stages(goal))
        if stage >= count:
            raise ActingError(
                f"object_features.stage: expected less than {count}, as {goal} has so many "
                f"programs, got {stage}",
                code="observation.stage",
            )
        ends = step.verdict is not None and step.verdict.truncated  # no action follows
        self._step, self._ready = None if ends else (step, goal), False
        return None

    def verdict(self, step: Step, goal: Goal) -> Verdict | None:
        """The verifier's verdict on a step; where nobody judged it, the agent's own.

        None before there are weights. Raises NetworkError for networks that can't judge.
        """
        if step.verdict is not None or self._actor is None or self._loaded is None:
            return step.verdict
        if self._own is None or not self._own.continues(step, goal):
            self._own = OwnJudgement(step, goal)
        scoring = self.scoring or Scoring.of(self._actor.network.world.relations)
        return self._own.verdict(step, self._actor, scoring)

    def pursued(self, step: Step, goal: Goal) -> Program:
        """The program of a goal that is to be pursued at a step."""
        if isinstance(goal, Program):
            return goal
        verdict = self.verdict(step, goal)
        return stages(goal)[verdict.stage if verdict is not None else 0]

    def required(self) -> PublishedPolicy | Wait:
        """The weights that must act on the current step, or what to wait for."""
        if self._step is None:
            return Wait("a step to act on")
        return self._newest or Wait("weights: none have arrived")

    def prepare(self) -> Wait | None:
        """Load the weights that must act on the current step.

        Returns what to wait for, or None: `act` may be called now.
        """
        policy = self.required()
        if isinstance(policy, Wait):
            return policy
        loaded = self._loaded
        if loaded is not policy and (loaded is None or loaded.name != policy.name):
            self._load(policy)
        self._ready = True
        return None

    def act(self) -> Float32:
        """The joint command at the current step, [J] in [-1, 1]. ActingError unless prepared."""
        step, actor = self._step, self._actor
        if step is None or actor is None or not self._ready:
            awaited = self.required()
            reason = awaited.reason if isinstance(awaited, Wait) else "no call of it at this step"
            raise ActingError(
                f"action: expected prepare() to return None before it, got {reason}",
                code="learning.step",
            )
        program, position = self.pursued(*step), step[0].observation.joint_position
        chosen = self._action(actor, step[0], program)
        return self._command(actor.network.world.joint_action(chosen, position))

    def hold(self) -> Float32:
        """Instead of `act`: the command that keeps the arm where it is, [J]. It is no experience.

        ActingError without a step to answer.
        """
        if self._step is None:
            raise ActingError(
                "action: expected an observation before it, got none", code="learning.step"
            )
        return self._command(self._step[0].observation.hold.astype(np.float32))

    def _command(self, action: Float32) -> Float32:
        self._step = None
        self.last_command = Executed(CommandKey(*self.key, next(self._numbers)), action)
        return action

    def relevance(self, step: Step, goal: Goal) -> tuple[float, ...]:
        """p of each object, of the program that is pursued at a step, under the weights in use;
        empty if their networks have no degrees."""
        if self._actor is None or not family_of(self._actor.network).evaluates_programs:
            return ()
        return self._actor.relevance(step.observation, self.pursued(step, goal))

    def _load(self, policy: PublishedPolicy) -> None:
        assert self._actor is not None  # `offer` made one before it kept the weights
        self._actor.load(policy.snapshot)
        self._loaded = policy

    def _action(self, actor: Actor, step: Step, program: Program) -> Float32:
        return actor.act(step.observation, program)


class OwnJudgement:
    """An agent's own verdicts on one goal, where no verifier is heard."""

    def __init__(self, step: Step, goal: Goal) -> None:
        self._key, self._watch = _of(step), GoalWatch(goal)
        self._verdict: tuple[int, Verdict] | None = None  # on the step of this stamp

    def continues(self, step: Step, goal: Goal) -> bool:
        """Whether a step is one under the same goal, in the same episode."""
        return self._key == _of(step) and self._watch.goal == goal

    def verdict(self, step: Step, actor: Actor, scoring: Scoring) -> Verdict:
        """The verdict on a step; each step is taken in once, however often it is asked."""
        seen = step.observation
        if self._verdict is None or self._verdict[0] != seen.stamp_ns:
            score = actor.judge(seen, scoring)
            self._verdict = seen.stamp_ns, self._watch.verdict(score, scoring.reward)
        return self._verdict[1]


def _of(step: Step) -> tuple[str, str, bool, int]:
    seen = step.observation
    return step.arena_id, seen.program_id, step.evaluation, seen.episode


def check_arena(learner: LearnerInfo, arena: ArenaFacts) -> None:
    """Raise ActingError unless the learner is one for this arena, and asks for a known backend.

    The algorithm does not matter here: architecture, exploration and inference say how to act.
    """
    for name in arena._fields:
        _check_fact(learner, arena, name)
    if learner.inference not in ("auto", "torch"):
        raise ActingError(
            f"learner_info.inference: expected 'auto' or 'torch', got {learner.inference!r}",
            code="learner.request",
        )


def network_of(learner: LearnerInfo) -> NetworkConfig:
    """The actor's network. ActingError if it cannot be built here."""
    try:
        return actor_config(learner.architecture)
    except ConfigError as error:
        raise ActingError(f"learner_info.architecture: {error}", code="learner.request") from error


def _check_fact(learner: LearnerInfo, arena: ArenaFacts, name: str) -> None:
    expected, received = getattr(arena, name), getattr(learner, name)
    if received != expected:
        raise ActingError(
            f"learner_info.{name}: expected {expected!r}, as this arena's, got {received!r}",
            code="learner.request",
        )
