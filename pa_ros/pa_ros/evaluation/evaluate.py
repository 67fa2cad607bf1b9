"""Score a policy on a condition, beside two references on the same episodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import Field

from pa_ros.arena import (
    ArenaChoice,
    ArenaConfig,
    Design,
    ReachTask,
    play,
    random_policy,
    scripted_action,
)
from pa_ros.arena.camera import PICTURES, PLAIN, Pictures
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64, Observation, Verdict
from pa_ros.core.settings import OneOf
from pa_ros.evaluation.blind import BLIND, blind_policy
from pa_ros.evaluation.scores import (
    EpisodeScore,
    Interval,
    gain_over,
    mean_interval,
    normalized,
    normalized_interval,
    rewards,
)
from pa_ros.language import LOGICS, MIN_MAX, Program, ProgramError, parse
from pa_ros.perception import task_seen
from pa_ros.world.world import World

# From an observation and a program to joint velocities in rad/s [J].
AgentPolicy = Callable[[Observation, Program], Float64]
# Seeds of episodes that no training run sees: for scores afterwards, and for scores during one.
EPISODES_SEED = 2_000_003
TRAINING_SCORES_SEED = 1_000_003
REFERENCES = ("scripted", "random")
SCENES_SEARCHED = 1000


def layouts_seed(seed: int, condition: str) -> int:
    """A seed of a condition's own. With one seed for all conditions, episode i has the same places
    and start in `train` and in `eval`, and their scores are not independent."""
    return int(np.random.SeedSequence([seed, *condition.encode()]).generate_state(1)[0])


class EvaluationConfig(ArenaChoice):
    """Which episodes are scored."""

    condition: str = Field("eval", description="that episodes are drawn from")
    episodes: int = Field(100, ge=1, description="how many")
    seed: int = Field(EPISODES_SEED, ge=0, description="of the episodes")
    layouts: Literal["shared", "own"] = Field(
        "shared",
        description="whether episode i has the same places and start in all conditions, as in "
        "the tables of RESULTS.md, or each condition its own",
    )
    logic: Annotated[str, OneOf(lambda: LOGICS)] = Field(
        MIN_MAX.name, description="logic by which an agent executes programs"
    )
    pictures: Annotated[str, OneOf(lambda: PICTURES)] = Field(
        "plain", description="how the world looks to the camera of an agent that sees"
    )
    judge: Annotated[str, OneOf(lambda: ("verifier", "agent"))] = Field(
        "verifier",
        description="who decides that a program of a goal is done, so that the next begins",
    )


@dataclass(frozen=True)
class Evaluation:
    """Scores of a policy and of both references on the same episodes of one condition."""

    condition: str
    scores: tuple[EpisodeScore, ...]
    random: tuple[EpisodeScore, ...]
    scripted: tuple[EpisodeScore, ...]
    blind: tuple[EpisodeScore, ...] = ()  # of the best reference of BLIND, if they were asked for

    @property
    def raw(self) -> Interval:
        """Reward per step."""
        return mean_interval(rewards(self.scores))

    @property
    def normalized(self) -> Interval:
        """Reward per step, 0 at the random and 1 at the scripted reference."""
        scores = rewards(self.scores)[None]
        return normalized_interval(scores, rewards(self.random), rewards(self.scripted))

    @property
    def gain(self) -> Interval:
        """How much higher it scores than the best blind reference, normalized."""
        references = map(rewards, (self.blind, self.random, self.scripted))
        return gain_over(rewards(self.scores)[None], *references)

    @property
    def success_rate(self) -> float:
        """Share of the episodes that ended with the program satisfied."""
        return float(np.mean([score.success for score in self.scores]))


def run_episodes(
    task: ReachTask, act: Callable[[Observation], Float64], condition: str, episodes: int
) -> Iterator[EpisodeScore]:
    """Run episodes 0 … episodes − 1 of a condition and score each."""
    for index in range(episodes):
        yield _score(task, play(task, act, task.reset(index, condition)))


def _score(task: ReachTask, steps: Iterable[tuple[Observation, Verdict]]) -> EpisodeScore:
    """The score of an episode of a task that is played to its end."""
    # The verdict of the reset is left out: it rewards no action of the policy.
    _, *verdicts = [verdict for _, verdict in steps]
    reward, end = sum(verdict.reward for verdict in verdicts) / len(verdicts), verdicts[-1]
    ever = any(verdict.satisfied for verdict in verdicts)
    ended = end.satisfied, end.distance, ever, end.stage, end.violated
    return EpisodeScore(task.episode.index, str(task.goal), reward, *ended)


def goal_ends(
    task: ReachTask, policy: AgentPolicy | str, condition: str, episodes: int
) -> Iterator[Verdict]:
    """The last verdicts of episodes of a condition, each of which ends as soon as its goal holds or
    is violated."""
    act = reference_policy(task, policy) if isinstance(policy, str) else pursuing(task, policy)
    for index in range(episodes):
        for _, verdict in play(task, act, task.reset(index, condition)):
            if verdict.satisfied or verdict.violated:
                break
        yield verdict


def pursuing(task: ReachTask, policy: AgentPolicy) -> Callable[[Observation], Float64]:
    """An agent's policy, under the program that the task's verifier pursues at each step."""
    return lambda observation: policy(observation, task.program)


def reference_policy(task: ReachTask, name: str) -> Callable[[Observation], Float64]:
    """`scripted` (it knows the target; the upper reference) or `random` (the lower one)."""
    policy = scripted_action if name == "scripted" else random_policy(task.seed)
    return lambda _: policy(task)


def reference_scores(
    task: ReachTask, name: str, condition: str, episodes: int
) -> tuple[EpisodeScore, ...]:
    """Scores of one of REFERENCES."""
    return tuple(run_episodes(task, reference_policy(task, name), condition, episodes))


def evaluate(
    config: ArenaConfig,
    design: Design,
    policy: AgentPolicy | str,
    condition: str,
    episodes: int,
    seed: int,
    perception: str = "",
    pictures: Pictures = PLAIN,
    pursued: Callable[[Observation, ReachTask], Program] | None = None,
    blind: bool = False,
) -> Evaluation:
    """Evaluate an agent, or a reference by name, and both references on the same episodes.

    `perception` is the calibration of the agent's camera, and `pictures` how the world looks to it
    (`perception.task_seen`). `pursued` says which program of a goal the agent executes at a step;
    by default the verifier. `blind`: score the references that ignore the program, too.
    """
    task = ReachTask(config, design, seed)
    # The same task plays the same episodes for each policy, so only the policies differ.
    references = {name: reference_scores(task, name, condition, episodes) for name in REFERENCES}
    if isinstance(policy, str):
        scores = references[policy]
    else:
        agent = policy
        camera = (perception, None, pictures)
        seen = task_seen(config, design, seed, *camera) if perception else task

        def act(observation: Observation) -> Float64:
            program = seen.program if pursued is None else pursued(observation, seen)
            return agent(observation, program)

        scores = tuple(run_episodes(seen, act, condition, episodes))
    ignorant = [
        tuple(run_episodes(task, blind_policy(task, name), condition, episodes))
        for name in (BLIND if blind else ())
    ]
    best = max(ignorant, key=lambda one: float(rewards(one).mean()), default=())
    return Evaluation(condition, scores, references["random"], references["scripted"], best)


@dataclass(frozen=True, slots=True)
class ProgramRow:
    """Mean scores of one program's episodes."""

    program: str
    episodes: int
    reward_per_step: float
    success_rate: float


def by_program(evaluation: Evaluation) -> list[ProgramRow]:
    """One row per program, in alphabetic order."""
    ordered = sorted(evaluation.scores, key=lambda score: score.program)
    rows = []
    for program, group in groupby(ordered, key=lambda score: score.program):
        rows.append(_row(program, list(group)))
    return rows


def _row(program: str, scores: Sequence[EpisodeScore]) -> ProgramRow:
    reward = float(np.mean([score.reward_per_step for score in scores]))
    success = float(np.mean([score.success for score in scores]))
    return ProgramRow(program, len(scores), reward, success)


def evaluate_programs(
    config: ArenaConfig,
    design: Design,
    policy: AgentPolicy,
    programs: Sequence[str],
    episodes: int,
    condition: str = "eval",
    perception: str = "",
    seed: int = EPISODES_SEED,
) -> list[ProgramRow]:
    """Mean scores of each program, over `episodes` scenes of a condition in which it can hold and
    does not yet. `perception` is that of `evaluate`.

    Raises ProgramError for a wrong program, ConfigError for one that has too few such scenes.
    """
    if episodes < 1:
        raise ConfigError(f"evaluate: expected at least one episode, got {episodes}")
    task, rows = task_seen(config, design, seed, perception), []
    for program in (parse(text, design.vocabulary) for text in programs):
        scores: list[EpisodeScore] = []
        for index in range(SCENES_SEARCHED):
            if len(scores) == episodes:
                break
            task.reset(index, condition)
            try:
                start = task.set_program(program)
            except ProgramError:  # it names nothing here
                continue
            _, verdict = start
            if not verdict.satisfied:
                scores.append(_score(task, play(task, pursuing(task, policy), start)))
        if len(scores) < episodes:
            raise ConfigError(
                f"evaluate: expected {episodes} scenes in which {program} can hold, found "
                f"{len(scores)} among {SCENES_SEARCHED} of condition {condition}: choose another "
                "condition or design"
            )
        rows.append(_row(str(program), scores))
    return rows


class Acts(Protocol):
    """A greedy actor."""

    def act(self, observation: Observation, program: Program) -> Float32:
        """The action, in [-1, 1]."""


def policy_of(actor: Acts, world: World, arena: ArenaConfig) -> AgentPolicy:
    """An actor's actions as joint velocities (rad/s) of an arena's arm."""
    speeds = np.array(arena.command_limits)

    def act(observation: Observation, program: Program) -> Float64:
        action = actor.act(observation, program)
        command = world.joint_action(action, observation.joint_position)
        return np.asarray(command.astype(np.float64) * speeds)

    return act


class TrainingScores:
    """Greedy scores of an actor during training, on the training and the held-out programs.

    The episodes are fixed and differ from those of training. The references on them are computed
    once, when they are first needed.
    """

    def __init__(
        self, config: ArenaConfig, design: Design, episodes: int, perception: str = ""
    ) -> None:
        self.task = task_seen(config, design, TRAINING_SCORES_SEED, perception)
        self._episodes = episodes
        self._conditions = ("train", "eval") if design.held_out else ("train",)

    @cached_property
    def _references(self) -> dict[str, list[float]]:
        """The mean reward of each of REFERENCES, by condition."""
        # References see the truth, and need no pictures.
        told = ReachTask(self.task.config, self.task.design, self.task.seed)
        return {
            condition: [
                float(rewards(reference_scores(told, name, condition, self._episodes)).mean())
                for name in REFERENCES
            ]
            for condition in self._conditions
        }

    def __call__(self, actor: Acts) -> dict[str, float]:
        """`{train,eval}_greedy.{reward_per_step,normalized,success_rate}`."""
        act = pursuing(self.task, policy_of(actor, self.task.world, self.task.config))
        row: dict[str, float] = {}
        for condition in self._conditions:
            scores = list(run_episodes(self.task, act, condition, self._episodes))
            raw = float(rewards(scores).mean())
            scripted, random = self._references[condition]
            row[f"{condition}_greedy.reward_per_step"] = raw
            row[f"{condition}_greedy.normalized"] = normalized(raw, random, scripted)
            row[f"{condition}_greedy.success_rate"] = float(np.mean([s.success for s in scores]))
        return row
