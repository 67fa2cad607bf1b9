"""The reaching task: episodes, programs, time limit and reward on top of the simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache

import numpy as np

from pa_ros.arena.appearance import look_of
from pa_ros.arena.conditions import condition_named
from pa_ros.arena.config import ArenaConfig, check_fits
from pa_ros.arena.designs import Design, Kind
from pa_ros.arena.episodes import Episode, generate
from pa_ros.arena.errors import ArenaError
from pa_ros.arena.faults import Faults
from pa_ros.arena.kinematics import hand_controller
from pa_ros.arena.simulation import HAND_INDEX, Simulation
from pa_ros.core.experience import Float32, Float64, Observation, Verdict
from pa_ros.language import Goal, Program, require_possible, roles
from pa_ros.world import Reward, Score, Scoring
from pa_ros.world.comparisons import choose
from pa_ros.world.progress import GoalWatch
from pa_ros.world.schema import PAPER, ObjectSchema
from pa_ros.world.world import World


def world_of(config: ArenaConfig, design: Design) -> World:
    """The world of an arm and a design."""
    controller = hand_controller(config) if config.hand_speed else None
    own = controller, config.gripper, config.thresholds
    return World(design.schema, design.vocabulary, config.joints, *own)


def scoring_of(config: ArenaConfig, design: Design, reward: Reward | None = None) -> Scoring:
    """The scoring rule of an arena; the default reward is the paper's ±1."""
    return Scoring.of(design.vocabulary.relations, config.thresholds, reward)


class Verifier:
    """Scores the true state under one program, for one set of blocks (paper, section "Programmable
    reaching environment"). This is privileged information.

    It does not score what the program avoids; `GoalVerifier` does."""

    def __init__(
        self,
        program: Program,
        kinds: Sequence[Kind],
        scoring: Scoring,
        schema: ObjectSchema = PAPER,
    ) -> None:
        """`kinds` are the blocks and places, which are objects 1, 2, …

        Raises ConfigError for an unknown relation.
        """
        # Raise ConfigError for an unknown relation now, not at the first step.
        scoring.threshold_of(program)
        words = _words(kinds)
        self.program = program
        sets = roles(program, words, HAND_INDEX, schema.bodiless)
        self.moved, self.targets = (tuple(np.flatnonzero(one).tolist()) for one in sets)
        """Objects that are to be moved, and those that they are to be related to; of a comparison,
        those that were chosen in the state scored last."""
        self._sets = self.moved, self.targets
        self._scoring, self._schema = scoring, schema

    @property
    def named(self) -> tuple[int, ...]:
        """The objects of both sets, without the hand."""
        return tuple(sorted({*self.moved, *self.targets} - {HAND_INDEX}))

    def score(self, objects: Float32, hand_pose: Float64) -> Score:
        """Score one state: object features [N, F], and the hand's pose [7] in the base's frame."""
        if self.program.compares:
            self.moved, self.targets = (
                choose(comparison, one, objects, hand_pose, self._schema)
                for comparison, one in zip(self.program.chosen, self._sets, strict=True)
            )
        sets = self.moved, self.targets
        return self._scoring.of_program(self.program, sets, objects, hand_pose)


class GoalVerifier:
    """Follows a goal over the true states of an episode, from the next one on. Privileged."""

    def __init__(
        self,
        goal: Goal,
        kinds: Sequence[Kind],
        scoring: Scoring,
        schema: ObjectSchema = PAPER,
    ) -> None:
        """Raises ProgramError if the goal cannot hold (`require_possible`), and ConfigError for an
        unknown relation."""
        require_possible(goal, _words(kinds), HAND_INDEX, schema.bodiless)
        self._scoring, self._schema, self._watch = scoring, schema, GoalWatch(goal)
        self.replace_blocks(kinds)

    def replace_blocks(self, kinds: Sequence[Kind]) -> None:
        """Continue with other blocks; a program may then name none of them."""
        own = kinds, self._scoring, self._schema
        self.verifier_of = lru_cache(None)(lambda program: Verifier(program, *own))
        for program in self._watch.stages:  # raises for a wrong one now
            self.verifier_of(program)
        self._pursue()

    @property
    def goal(self) -> Goal:
        """The whole goal."""
        return self._watch.goal

    def steps(self, config: ArenaConfig) -> int:
        """Actions of an episode under the goal."""
        return config.episode_steps * len(self._watch.stages)

    def verdict(self, objects: Float32, hand_pose: Float64, truncated: bool = False) -> Verdict:
        """The verdict on the next state, and whether the episode's time limit is reached."""

        def score(program: Program) -> Score:
            known = self.pursued if program is self.pursued.program else self.verifier_of(program)
            return known.score(objects, hand_pose)

        verdict = self._watch.verdict(score, self._scoring.reward, truncated)
        if self.program is not self._watch.program:
            self._pursue()
        return verdict

    def _pursue(self) -> None:
        self.program = self._watch.program
        """The program of the goal that counts now."""
        self.pursued = self.verifier_of(self.program.relation_alone)
        """Its verifier, without what it avoids."""


def _words(kinds: Sequence[Kind]) -> list[tuple[str, ...]]:
    return [(), *(tuple(str(kind).split()) for kind in kinds)]


class ReachTask:
    """Reach for the object that the program names (paper, "Programmable reaching environment").

    An episode has `config.episode_steps` actions for each program of its goal; then
    `Verdict.truncated` is set and the next call must be a reset. Episodes never terminate. The
    stamp of each observation, including those of resets, is one control period later than the
    previous one.
    """

    def __init__(
        self,
        config: ArenaConfig,
        design: Design,
        seed: int,
        reward: Reward | None = None,
    ) -> None:
        """`seed` and the index determine an episode. The default reward is the paper's ±1.

        Raises ConfigError for a value of the design that has no look, or an arena that the design
        does not fit.
        """
        # A value without a look must not surface at the first episode that happens to draw it.
        for kind in (*design.extended_pool, *design.places):
            look_of(kind)
        check_fits(config, design)
        self.config = config
        self.scoring = scoring_of(config, design, reward)
        self.design = design
        self.seed = seed
        self.simulation = Simulation(config, self.design.schema)
        self._episode: Episode | None = None
        self._faults: Faults | None = None
        self._stamp_ns, self._period_ns = 0, config.control_period_ns
        self._step, self._limits = 0, np.array(config.command_limits)

    @property
    def world(self) -> World:
        """The facts that agents and learners of this task must agree on."""
        return world_of(self.config, self.design)

    @property
    def control_period_s(self) -> float:
        """Simulation time of one control step, s."""
        return self.config.control_period_s

    def reset(self, episode_index: int, condition: str = "train") -> tuple[Observation, Verdict]:
        """Start episode `episode_index` of a condition; ConfigError for an unknown condition."""
        drawn_from = condition_named(condition, self.design)
        return self.reset_to(
            generate(self.config, self.design, drawn_from, self.seed, episode_index)
        )

    def reset_to(self, episode: Episode) -> tuple[Observation, Verdict]:
        """Start a given episode with its own goal."""
        verifier = self._verifier(episode, episode.goal)
        self.simulation.place(episode)
        self._episode, self._goal = episode, verifier
        self._step, self._programs = 0, 0
        if self.config.faults:
            self._faults = Faults(self.seed, episode.index, self.config.control_period_s)
        self._look()
        self.program_id = f"{episode.index}.0"
        self._stamp_ns += self._period_ns
        return self._observe()

    def set_program(
        self, program: Goal, program_id: str | None = None
    ) -> tuple[Observation, Verdict]:
        """Change the goal; returns the current step, which is the new goal's first.

        Raises ProgramError if the goal cannot hold in this episode; then nothing changes. The
        default id is new in this episode.
        """
        episode = self.episode
        self._goal = self._verifier(episode, program)
        self._programs += 1
        self.program_id = program_id or f"{episode.index}.{self._programs}"
        return self._observe()

    def check(self, program: Goal, episode: Episode) -> None:
        """Raise ProgramError unless the goal can hold in an episode."""
        self._verifier(episode, program)

    def rearrange(self, episode: Episode, poses: Float64, twists: Float64) -> None:
        """Continue the episode with other blocks (see `Simulation.rearrange`). Goal, stage, step
        and time stay; the goal may name nothing now."""
        self.simulation.rearrange(episode, poses, twists)
        self._episode = episode
        if self._faults is not None:
            self._faults.forget()
        self._look()
        kinds = [block.kind for block in episode.blocks]
        self._goal.replace_blocks(kinds)

    def close(self) -> None:
        """Free what the task holds outside Python; then it must not be used."""

    @property
    def goal(self) -> Goal:
        """The current goal."""
        return self._goal.goal

    @property
    def verifier(self) -> Verifier:
        """The verifier of the program that is pursued at the current step."""
        return self._goal.pursued

    def verifier_of(self, program: Program) -> Verifier:
        """The verifier of any program in the current episode."""
        return self._goal.verifier_of(program)

    @property
    def program(self) -> Program:
        """The program of the goal that is pursued at the current step: the goal itself, unless it
        has several."""
        return self._goal.program

    def step(self, command: Float64) -> tuple[Observation, Verdict]:
        """Act for one control period with joint velocities in rad/s [J], clamped to the limits, and
        the gripper if the arm has one (on above 0).

        Raises ArenaError: arena.command for a command of the wrong size or with non-finite numbers,
        arena.episode before the first reset and after the time limit. Then nothing moves.
        """
        if self._episode is None or self._step >= self._goal.steps(self.config):
            raise ArenaError(f"step {self._step}: expected a reset before", code="arena.episode")
        command = np.asarray(command, dtype=np.float64)
        if command.shape != self._limits.shape or not np.isfinite(command).all():
            raise ArenaError(
                f"joint command: expected {len(self._limits)} finite numbers (rad/s), "
                f"got {command.tolist()}",
                code="arena.command",
            )
        return self.advance(np.minimum(np.maximum(command, -self._limits), self._limits))

    def advance(self, command: Float64) -> tuple[Observation, Verdict]:
        """Act like `step`, with a command that is known to be finite and within limits."""
        if self._faults is not None:
            command = self._faults.command(command)
        self.simulation.advance(command)
        self._look()
        self._step += 1
        self._stamp_ns += self._period_ns
        return self._observe()

    def _verifier(self, episode: Episode, goal: Goal) -> GoalVerifier:
        kinds = [block.kind for block in episode.blocks]
        return GoalVerifier(goal, kinds, self.scoring, self.design.schema)

    @property
    def episode(self) -> Episode:
        """The current episode; ArenaError (arena.episode) before the first reset."""
        if self._episode is None:
            raise ArenaError("expected a reset before the first step", code="arena.episode")
        return self._episode

    def _look(self) -> None:
        """Measure the objects, once in each state: the faults draw random numbers."""
        if self._faults is not None:
            simulation = self.simulation
            self._seen = self._faults.measured(simulation.objects(), simulation.hand_pose)

    def _observe(self) -> tuple[Observation, Verdict]:
        true = self.simulation.objects()
        observation = Observation(
            episode=self.episode.index,
            step=self._step,
            stamp_ns=self._stamp_ns,
            objects=true if self._faults is None else self._seen,
            joint_position=self.simulation.joint_position,
            joint_velocity=self.simulation.joint_velocity,
            hand_index=HAND_INDEX,
            program_id=self.program_id,
            hand_pose=self.simulation.hand_pose,
        )
        truncated = self._step >= self._goal.steps(self.config)
        verdict = self._goal.verdict(true, observation.hand_pose, truncated)
        return observation, verdict


def play(
    task: ReachTask, act: Callable[[Observation], Float64], start: tuple[Observation, Verdict]
) -> Iterator[tuple[Observation, Verdict]]:
    """Play an episode to its time limit; yields each step, first `start`, which began it.

    `act` returns joint velocities in rad/s [J] for the step that was yielded last.
    """
    observation, verdict = start
    yield observation, verdict
    while not verdict.truncated:
        observation, verdict = task.step(act(observation))
        yield observation, verdict
