"""Episodes and programs of one arena, without ROS."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from pathlib import Path

import numpy as np

from pa_ros.arena import (
    ArenaError,
    Episode,
    condition_named,
    generate,
    training_programs,
)
from pa_ros.core.errors import PaError
from pa_ros.core.experience import CommandKey, Executed, Float64, Observation, Step, Verdict
from pa_ros.language import Goal
from pa_ros.language.errors import ProgramError
from pa_ros.perception import TOLD, VIEWS, calibrated, task_seen
from pa_ros.provenance import origin
from pa_ros.provenance.arena import describe
from pa_ros.wire.arena import ArenaDescription, Mode
from pa_ros.wire.diagnostics import Origin
from pa_ros.wire.program import ProgramRequest, program_id_of
from pa_ros.wire.program_book import ProgramBook
from pa_ros.wire.services import ResetRequest
from pa_ros.wire.step import Command
from pa_ros.world import reward_from
from sim_node.config import LAST_EPISODE, SimConfig

RECENT_EPISODES = 20  # the reported mean rewards are over this many


class SimError(PaError):
    """A message or request that the arena rejects; `code` says why."""


class SimulatorError(SimError):
    """A rejected request of the standard simulator's services; `result` is the standard's code."""

    def __init__(self, text: str, result: int) -> None:
        super().__init__(text, code="arena.request")
        self.result = int(result)


@dataclass(frozen=True)
class ActiveProgram:
    """A program and the id under which it was announced."""

    program_id: str
    program: Goal

    @cached_property
    def text(self) -> str:
        """The canonical text."""
        return str(self.program)


class Session:
    """Which episode runs next, under which program, and with which rewards.

    `current` is the step that was published last. Training and evaluation episodes are numbered
    apart, so that evaluating doesn't change what is trained on.
    """

    current: Step
    program: ActiveProgram | None  # None: the arm waits for one

    def __init__(self, config: SimConfig, arena_id: str) -> None:
        self.config = config
        self.arena_id = arena_id
        self.arena = config.arena_config()
        reward = reward_from(config.reward)
        self.perception = _calibration(config)
        told = self.arena, config.design_of(), config.seed
        self.task = task_seen(*told, self.perception, reward)
        self.book = ProgramBook(self.task.design.vocabulary, own=f"{arena_id}/")
        self.speed_limits = np.array(self.arena.command_limits)  # [J] rad/s
        self.steps = 0  # control periods so far
        self.clamped = 0  # commands outside [-1, 1] so far
        self.disturbed = False  # someone moved blocks after the current step was published
        self.rewards = {kind: deque[float](maxlen=RECENT_EPISODES) for kind in (False, True)}
        self._episode_rewards: list[float] = []
        every = config.eval_every_episodes
        self._next = {False: config.first_episode, True: config.first_episode // (every or 1)}
        self._evaluation_due = False
        self._requested: ActiveProgram | None = None  # the newest program that a person sent

    @property
    def hold(self) -> Float64:
        """The command that stops the arm."""
        return self.current.observation.hold

    # Steps

    def apply(self, command: Command) -> Step:
        """Act for one control period as commanded; see `advance`."""
        largest = max(map(abs, command.action.tolist()))
        action = command.action
        if largest > 1.0:
            self.clamped += 1
            action = np.clip(action, -1.0, 1.0)
        # Experience must show the action that the agent chose at this very step. In real time a
        # command may be held over from an earlier step, and then no command counts as executed.
        chosen_here = command.stamp_ns == self.current.observation.stamp_ns
        unaltered = largest <= 1.0 and bool(command.agent_id) and chosen_here
        key = CommandKey(command.agent_id, command.incarnation, command.number)
        executed = Executed(key, action) if unaltered else None
        return self.advance(action.astype(np.float64) * self.speed_limits, executed)

    def advance(self, velocity: Float64, executed: Executed | None = None) -> Step:
        """Act for one control period with joint velocities in rad/s, [J]; the step it led to.

        Call `finish_step` after it. Raises PhysicsError; the episode is then void.
        """
        observation, verdict = self.task.advance(velocity)
        if self.disturbed:
            executed, self.disturbed = None, False
        self.steps += 1
        self._show(observation, verdict, self.current.evaluation, executed)
        return self.current

    def finish_step(self) -> bool:
        """Count the step's reward; whether the episode ended, and the next one began with it."""
        verdict, evaluation = self.current.verdict, self.current.evaluation
        assert verdict is not None  # an arena judges every step
        self._episode_rewards.append(verdict.reward)
        if verdict.truncated:
            self.rewards[evaluation].append(float(np.mean(self._episode_rewards)))
            self.begin()
        return verdict.truncated

    # Episodes

    def begin(self, request: ResetRequest | None = None) -> Step:
        """Begin the next episode, or the requested one. A rejected request changes nothing.

        Raises ProgramError if the requested program can't be executed in that scene, WireError if
        its id already means another program, ArenaError if there is no such episode.
        """
        request = request or ResetRequest(evaluation=self._evaluation_due)
        evaluation = request.evaluation
        index = self._next[evaluation] if request.episode is None else request.episode
        if request.episode is not None and index > LAST_EPISODE:
            raise ArenaError(
                f"episode: expected a number up to {LAST_EPISODE}, got {index}",
                code="arena.episode",
            )
        episode = self.scene(evaluation, index)
        program = self._first_program(episode, evaluation, request.program)
        self.task.reset_to(episode)
        self._next[evaluation] = index + 1
        every = self.config.eval_every_episodes
        self._evaluation_due = not evaluation and every > 0 and (index + 1) % every == 0
        self._episode_rewards = []
        self._show_current_step(program, evaluation)
        return self.current

    def scene(self, evaluation: bool, index: int) -> Episode:
        """How an episode begins: its blocks, their places, and the generator's program."""
        name = self.config.eval_condition if evaluation else self.config.condition
        condition = condition_named(name, self.task.design)
        return generate(self.arena, self.task.design, condition, self.config.seed, index)

    # Programs

    def submit(self, request: ProgramRequest) -> str:
        """Activate a person's program from the next step on; its canonical text.

        Where no program was active, the current step is the first one under it. Raises, with
        nothing changed, ProgramError for text that isn't a program or names no block here, and
        WireError if its id already means another program.
        """
        program = self._checked(request, self.task.episode)
        self.book.bind(program.program_id, program.text)
        self._requested = program
        if self.program is None:
            self._show_current_step(program, self.current.evaluation)
        else:
            self.program = program
            self.task.set_program(program.program, program.program_id)
        return program.text

    def _first_program(
        self, episode: Episode, evaluation: bool, requested: str
    ) -> ActiveProgram | None:
        """The program that an episode begins with; None where the arm waits for one."""
        if requested:
            program = self._checked(ProgramRequest(program_id_of(requested), requested), episode)
            self.book.bind(program.program_id, program.text)
            self._requested = program
            return program
        if self.config.program_source == "generator":
            kind = "eval" if evaluation else "train"
            own = ActiveProgram(f"{self.arena_id}/{kind}/{episode.index}", episode.goal)
            self.book.name(own.program_id, own.text)
            return own
        if self._requested is not None:
            with suppress(ProgramError):
                self.task.check(self._requested.program, episode)
                return self._requested
        return None

    def _checked(self, request: ProgramRequest, episode: Episode) -> ActiveProgram:
        program = self.book.program(request.text)
        self.task.check(program, episode)
        return ActiveProgram(request.program_id, program)

    # The current step

    def _show_current_step(self, program: ActiveProgram | None, evaluation: bool) -> None:
        """Make the task's current step the arena's, under a program."""
        self.program = program
        executed = program.program if program else self.task.episode.goal
        program_id = program.program_id if program else None
        self._show(*self.task.set_program(executed, program_id), evaluation, None)

    def _show(
        self,
        observation: Observation,
        verdict: Verdict,
        evaluation: bool,
        executed: Executed | None,
    ) -> None:
        text = ""
        if self.program is not None:
            text = self.program.text
        else:  # nothing is satisfied without an active program
            observation = replace(observation, program_id="")
            reward = float(self.task.scoring.reward(False, inf))
            verdict = replace(
                verdict, reward=reward, satisfied=False, distance=inf, stage=0, violated=False
            )
        self.current = Step(observation, verdict, text, evaluation, executed, self.arena_id)

    # Descriptions of the arena

    def describe(self) -> ArenaDescription:
        """The arena's description, which is published once."""
        design, config = self.task.design, self.config
        mode = Mode.LOCKSTEP if config.mode == "lockstep" else Mode.REAL_TIME
        programs, reward = training_programs(design), self.task.scoring.reward
        about = describe(self.arena, design, config.seed, programs, self.arena_id, mode, reward)
        # A condition may have more blocks than the design, or fewer.
        blocks = len(self.scene(False, config.first_episode).blocks)
        world, perception = self.task.world, self.perception
        return replace(about, block_count=blocks, world=world, perception=perception)

    def origin(self, node: str) -> Origin:
        """Software, settings and world of this arena, for recordings; `node` is its full name."""
        return origin(
            node,
            self.arena_id,
            self.config.seed,
            parameters=self.config.flat(),
            design=self.task.design.name,
            arm=self.arena.arm,
            preset=self.arena.preset,
            world=self.task.world,
        )


def _calibration(config: SimConfig) -> str:
    """The calibration of the arena's camera; empty if properties are told.

    Raises ConfigError for the checkpoint of an agent that sees through none.
    """
    if config.perception in (TOLD, *VIEWS):
        return calibrated(config.arena_config(), config.design_of(), config.perception)
    # It imports torch, which other arenas do not need.
    from pa_ros.learning.checkpoints import camera_of

    return camera_of(Path(config.perception))
