"""Episodes and programs of one arena on the graph, without ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import inf

import numpy as np

from pa_ros.arena import Episode, EpisodeError, ReachTask, generate
from pa_ros.core.experience import Executed, Float64, Observation, Verdict
from pa_ros.language import Program, parse, require_target
from pa_ros.language.errors import ProgramError
from pa_ros.wire.program import ProgramRequest, program_id_of
from pa_ros.wire.services import ResetRequest
from pa_ros.wire.step import Command
from pa_ros.world import reward_from
from sim_node.config import LAST_EPISODE, SimConfig
from sim_node.errors import NoProgramError, StaleCommandError
from sim_node.program_ids import ProgramIds

RECENT = 20  # episodes that the reported means are over


@dataclass(frozen=True)
class Frame:
    """One control step as it goes on the wire."""

    observation: Observation
    judge: Callable[[], Verdict]  # called before anything else happens in the arena
    evaluation: bool
    executed: Executed | None  # the command that, exactly, led here; None: no one's
    program: str  # that the observation's program id stands for; empty: none

    @cached_property
    def verdict(self) -> Verdict:
        """Determined when it is asked for: agents that learn nothing need not wait for it."""
        return self.judge()


@dataclass(frozen=True)
class Ordered:
    """A program that was asked for, by the id under which it is announced."""

    program_id: str
    program: Program

    @cached_property
    def text(self) -> str:
        """Canonical."""
        return str(self.program)


class Session:
    """What runs next, under which program, and how it went. `frame` is where the arena stands.

    Training and evaluation episodes are numbered apart, so that evaluating changes nothing else.
    """

    frame: Frame
    program: Ordered | None  # in force

    def __init__(self, config: SimConfig, arena_id: str) -> None:
        self.config = config
        self.arena_id = arena_id
        self.arena = config.arena_config()
        reward = reward_from(config.reward)
        self.task = ReachTask(self.arena, config.design_of(), config.seed, reward=reward)
        self.speed_limits = np.array(self.arena.joint_speed_limits)
        self.steps = 0  # control periods taken
        self.disturbed = False  # someone has moved blocks since the step that stands
        self.clamped = 0  # commands that were outside [-1, 1]
        self.rewards = {kind: deque[float](maxlen=RECENT) for kind in (False, True)}
        every = config.eval_every_episodes
        self._condition_of = lru_cache(config.condition_of)
        self._next = {False: config.first_episode, True: config.first_episode // (every or 1)}
        self._evaluation_due = False
        self._user: Ordered | None = None  # the newest program that someone sent
        self.program_ids = ProgramIds(arena_id)
        self._episode_rewards: list[float] = []

    @property
    def hold(self) -> Float64:
        """The command that keeps the arm where it is, [J] rad/s."""
        return np.zeros(self.arena.joints)

    def begin(self, request: ResetRequest | None = None) -> Frame:
        """Begin the next episode, or the one asked for. A refusal changes nothing.

        Raises ProgramError if the request's program cannot be executed in that scene,
        EpisodeError if there is no such scene.
        """
        request = request or ResetRequest(evaluation=self._evaluation_due)
        evaluation = request.evaluation
        index = self._next[evaluation] if request.episode is None else request.episode
        if request.episode is not None and index > LAST_EPISODE:
            raise EpisodeError(f"episode: expected a number up to {LAST_EPISODE}, got {index}")
        episode = self.scene(evaluation, index)
        program = self._program_of(episode, evaluation, request.program)
        self.task.reset_to(episode)
        self._next[evaluation] = index + 1
        every = self.config.eval_every_episodes
        self._evaluation_due = not evaluation and every > 0 and (index + 1) % every == 0
        self._episode_rewards = []
        self._stand(program, evaluation)
        return self.frame

    def scene(self, evaluation: bool, index: int) -> Episode:
        """How an episode begins: its blocks, where they are, and the generator's program."""
        condition = self.config.eval_condition if evaluation else self.config.condition
        drawn_from = self._condition_of(condition)
        return generate(self.arena, self.task.design, drawn_from, self.config.seed, index)

    def submit(self, request: ProgramRequest) -> str:
        """Put someone's program in force from the next step on; its canonical text.

        Where none was in force, the step that stands is the first one under it. Raises, with
        nothing changed, ProgramError if it is not a program or names no block here, and
        WireError if its id has another meaning.
        """
        assert self.task.episode is not None
        program = self._checked(request, self.task.episode)
        self.program_ids.bind(program.program_id, program.text)
        self._user = program
        if self.program is None:
            self._stand(program, self.frame.evaluation)
        else:
            self.program = program
            self.task.set_program(program.program, program.program_id)
        return program.text

    def check(self, command: Command) -> None:
        """Raise StaleCommandError unless it answers the step that stands, NoProgramError if
        there is nothing to answer."""
        if self.program is None:
            raise NoProgramError("joint_commands: expected a program first, got none")
        stands = self.frame.observation
        expected = (stands.episode, stands.step, stands.stamp_ns)
        received = (command.episode, command.step, command.stamp_ns)
        if received != expected:
            raise StaleCommandError(
                f"joint_commands: expected (episode, step, stamp) {expected}, got {received}"
            )

    def apply(self, command: Command) -> Iterator[Frame]:
        """Act for one control period as commanded, clamped to [-1, 1]; see `advance`."""
        exact = max(map(abs, command.action.tolist())) <= 1.0
        action = command.action if exact else np.clip(command.action, -1.0, 1.0)
        self.clamped += not exact
        stands = self.frame.observation
        answered = exact and bool(command.agent_id) and command.stamp_ns == stands.stamp_ns
        executed = Executed(command.key, action) if answered else None
        return self.advance(action.astype(np.float64) * self.speed_limits, executed)

    def advance(self, velocity: Float64, executed: Executed | None = None) -> Iterator[Frame]:
        """Act for one control period, rad/s; yield the step it led to and, if that was the
        episode's last, the next episode's first. Raises DivergedError, the episode then void."""
        evaluation = self.frame.evaluation
        observation = self.task.advance(velocity)
        if self.disturbed:  # not the command alone led here
            executed, self.disturbed = None, False
        self.steps += 1
        self._frame(
            observation, lambda: self._masked(self.task.judge(observation)), evaluation, executed
        )
        yield self.frame
        verdict = self.frame.verdict
        self._episode_rewards.append(verdict.reward)
        if verdict.truncated:
            self.rewards[evaluation].append(float(np.mean(self._episode_rewards)))
            yield self.begin()

    def _stand(self, program: Ordered | None, evaluation: bool) -> None:
        """Make the task's present step the frame, under a program."""
        assert self.task.episode is not None
        self.program = program
        executed = program.program if program else self.task.episode.program
        program_id = program.program_id if program else None
        observation, verdict = self.task.set_program(executed, program_id)
        verdict = self._masked(verdict)  # now: another program may come while the step stands
        self._frame(observation, lambda: verdict, evaluation, None)

    def _frame(
        self,
        observation: Observation,
        judge: Callable[[], Verdict],
        evaluation: bool,
        executed: Executed | None,
    ) -> None:
        text = self.program.text if self.program else ""
        shown = observation if self.program else replace(observation, program_id="")
        self.frame = Frame(shown, judge, evaluation, executed, text)

    def _masked(self, verdict: Verdict) -> Verdict:
        """Without a program in force there is nothing to satisfy."""
        if self.program is not None:
            return verdict
        reward = float(self.task.scoring.reward(False, inf))
        return replace(verdict, program_id="", reward=reward, satisfied=False, distance=inf)

    def _program_of(self, episode: Episode, evaluation: bool, wanted: str) -> Ordered | None:
        """The program that an episode begins with."""
        if wanted:
            asked = self._checked(ProgramRequest(program_id_of(wanted), wanted), episode)
            self.program_ids.bind(asked.program_id, asked.text)
            self._user = asked
            return asked
        if self.config.program_source == "generator":
            kind = "eval" if evaluation else "train"
            own = Ordered(f"{self.arena_id}/{kind}/{episode.index}", episode.program)
            self.program_ids.announce(own.program_id, own.text)
            return own
        try:
            return self._user and self._naming(self._user, episode)
        except ProgramError:  # accepted in another scene; here it names nothing
            return None

    def _checked(self, request: ProgramRequest, episode: Episode) -> Ordered:
        program = parse(request.text, self.task.design.vocabulary)
        return self._naming(Ordered(request.program_id, program), episode)

    def _naming(self, ordered: Ordered, episode: Episode) -> Ordered:
        """The same; ProgramError if it names no block of the episode."""
        require_target(ordered.program, [block.kind.words for block in episode.blocks], None)
        return ordered
