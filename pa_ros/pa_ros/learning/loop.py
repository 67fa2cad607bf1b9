"""The one loop: actor, environment and learner in one process, without ROS.

Over the graph the same objects take the same steps in the same order (docs/DESIGN.md, "The
synchronous protocol"), so the same seed gives the same weights, bit for bit, either way.
"""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from pydantic import Field

from pa_ros.acting.actor import Actor
from pa_ros.acting.agent import ArenaFacts, Step
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import AgentKey, Float64, Observation, Verdict
from pa_ros.core.published import PublishedPolicy
from pa_ros.core.settings import Settings
from pa_ros.language import PRODUCT, Program
from pa_ros.learning.checkpoints import check_facts, read_metadata, restore, save_checkpoint
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.errors import CheckpointError, DivergedError
from pa_ros.learning.folder import checkpoint_of, claim, holds_checkpoint
from pa_ros.learning.learner import Learner
from pa_ros.learning.newest import make_latest, newest_whole
from pa_ros.learning.progress import Progress, Rewards
from pa_ros.learning.run import LearningRun
from pa_ros.networks.config import NetworkConfig
from pa_ros.world import Scoring, Trajectory

log = logging.getLogger(__name__)

Evaluate = Callable[[Actor], dict[str, float]]
"""Greedy scores of an actor by column name; must not disturb the training environment."""


class Environment(Protocol):
    """What the loop trains on; `pa_ros.arena.ReachTask` is one."""

    @property
    def program(self) -> Program:
        """The program that the verifier scores by now."""

    @property
    def scoring(self) -> Scoring:
        """The rule of its rewards, by which the learner relabels."""

    @property
    def control_period_s(self) -> float:
        """Simulation time of one control step."""

    def reset(self, episode_index: int, condition: str) -> tuple[Observation, Verdict]:
        """Begin an episode, fixed by its index."""

    def step(self, joint_velocity: Float64) -> tuple[Observation, Verdict]:
        """Act for one control period, rad/s, [J]."""


class Log(Protocol):
    """Is told what a run does; `pa_ros.bags.run_log.RunLog` records it. Must change nothing."""

    def begin(self, run: LearningRun) -> None:
        """Before the first step."""

    def add(self, trajectory: Trajectory, policy: PublishedPolicy) -> None:
        """After the learner took a trajectory in, with what came of it; on its thread."""


class Watcher(Protocol):
    """Is told how far a run is. Must change nothing."""

    def episode(self, frames: int, steps: int, reward: float) -> None:
        """After an episode of so many steps and this mean reward; `frames` steps in all."""

    def row(self, row: Mapping[str, float]) -> None:
        """After an evaluation: the row of progress.csv."""


class TrainConfig(Settings):
    """One training run. `design`, `preset`, `arm` and `reward` name the caller's environment."""

    SECTION: ClassVar[str] = "train"

    out: Path = Field(description="folder for curve and checkpoint")
    seed: int = Field(0, ge=0, description="of episodes, exploration and weights")
    frames: int = Field(100_000, ge=1, description="control steps to train for, whole episodes")
    design: str = Field("2-L", description="of the environment")
    preset: str = Field("fast", description="of the environment")
    arm: str = Field("jaco", description="of the environment")
    reward: str = Field(
        "sparse", description="of the environment: a name, or JSON of name and parameters"
    )
    condition: str = Field("train", description="that episodes are drawn from")
    agent_id: str = Field("agent", description="of the one agent")
    evaluate_every_frames: int = Field(
        10_000, ge=0, description="frames between evaluations, rows of progress.csv; 0: never"
    )
    evaluation_episodes: int = Field(
        20, ge=1, description="episodes of each evaluation, which the caller makes"
    )
    checkpoint_every_frames: int = Field(
        50_000, ge=0, description="frames between checkpoints; 0: only at the end"
    )
    overlap: bool = Field(
        True, description="act while the learner updates, where policy_lag allows; same result"
    )


def train(
    config: TrainConfig,
    network: NetworkConfig,
    learner_config: LearnerConfig,
    environment: Environment,
    max_speed: Float64,
    training_programs: Sequence[Program],
    evaluate: Evaluate | None = None,
    resume: bool = False,
    run_log: Log | None = None,
    watcher: Watcher | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Learner:
    """Train for `config.frames` control steps, whole episodes, or until `stopped`; the learner.

    `max_speed` is [J] rad/s: a velocity command is the action times it. Leaves progress.csv and
    `checkpoint/` under `config.out`. With `resume`, goes on from the checkpoint there (raises
    CheckpointError if there is none that fits), and ends where an unbroken run would have. Raises
    FolderTakenError if another run writes into `config.out`, or if it holds a run that is not to be
    resumed.
    """
    if learner_config.schedule.in_step == "free":
        raise ConfigError(
            "learner.schedule.in_step: expected 'arrival' or 'exact' in one process, got 'free': "
            "whom nobody waits for has to run beside the learner"
        )
    # First, so that settings which are refused leave no folder.
    learner = Learner(network, learner_config, training_programs, config.seed, environment.scoring)
    if resume and not holds_checkpoint(config.out):
        raise CheckpointError(
            f"checkpoint: expected one at {checkpoint_of(config.out)}, found none"
        )
    with claim(config.out, resume):
        extra = _resume(config, learner) if resume else {}
        learning = LearningRun(learner, environment.control_period_s, extra)
        if run_log is not None:
            run_log.begin(learning)
        wall_s, rewards = _wall_s(extra), Rewards.of(extra) if resume else Rewards()
        told = wall_s, rewards, resume, run_log, watcher
        with _Run(config, learning, environment, max_speed, evaluate, *told) as run:
            run.until(config.frames, stopped)
        return learner


def _resume(config: TrainConfig, learner: Learner) -> dict[str, Any]:
    """Restore the learner of the same run; what else its checkpoint says."""
    path, passed_over = newest_whole(checkpoint_of(config.out))
    if passed_over:
        log.warning(passed_over)
        make_latest(path)
    facts = {name: getattr(config, name) for name in ("seed", "design", "preset", "arm")}
    check_facts(path, read_metadata(path), **facts)
    return restore(path, learner)


def _wall_s(extra: Mapping[str, Any]) -> float:
    """Seconds that a run has taken, by its checkpoint."""
    wall_s = extra.get("wall_s", 0.0)
    if not (isinstance(wall_s, int | float) and 0.0 <= wall_s < float("inf")):
        raise CheckpointError(f"checkpoint: wall_s: expected seconds, got {wall_s!r}")
    return float(wall_s)


class _Transport:
    """Takes an agent's trajectories to the learner, in order, and the weights back."""

    def __init__(self, run: LearningRun, overlap: bool, run_log: Log | None) -> None:
        self._run, self._log = run, run_log
        self._answers: deque[Callable[[], PublishedPolicy]] = deque()  # one per trajectory
        self._thread = ThreadPoolExecutor(1, "learner") if overlap else None

    def send(self, trajectory: Trajectory) -> None:
        if self._thread is None:
            policy = self._consume(trajectory)
            self._answers.append(lambda: policy)
        else:
            self._answers.append(self._thread.submit(self._consume, trajectory).result)

    def receive(self) -> PublishedPolicy:
        """The weights that came of the next trajectory; waits for them."""
        return self._answers.popleft()()

    def drain(self) -> None:
        """Wait until every trajectory is consumed: only then may the learner be looked at."""
        for answer in self._answers:
            answer()

    def close(self) -> None:
        if self._thread is not None:
            self._thread.shutdown(cancel_futures=True)
        self._answers.clear()

    def _consume(self, trajectory: Trajectory) -> PublishedPolicy:
        self._run.consume(trajectory)
        policy = self._run.policy()
        if self._log is not None:
            self._log.add(trajectory, policy)
        return policy


class _Run:
    """One call of `train`."""

    def __init__(
        self,
        config: TrainConfig,
        learning: LearningRun,
        environment: Environment,
        max_speed: Float64,
        evaluate: Evaluate | None,
        wall_s: float,
        rewards: Rewards,
        resume: bool,
        run_log: Log | None,
        watcher: Watcher | None,
    ) -> None:
        learner = learning.learner
        self._config, self._learning, self._learner = config, learning, learner
        self._environment, self._max_speed = environment, max_speed
        self._evaluate, self._watcher = evaluate, watcher
        self._started = time.monotonic() - wall_s
        self._agent = _make_agent(config, learning)
        overlap = config.overlap and learning.info.policy_lag > 0
        self._transport = _Transport(learning, overlap, run_log)
        self._frames = learner.counters.frames
        self._rewards = rewards
        resumed_frames = self._frames if resume else None
        self._progress = Progress(config.out / "progress.csv", resumed_frames)

    def __enter__(self) -> _Run:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        self._transport.close()
        if isinstance(error, DivergedError) and error.restored:
            self._save()

    def until(self, frames: int, stopped: Callable[[], bool]) -> None:
        """Episodes until `frames` steps were taken, or `stopped`; then a checkpoint."""
        episode = self._learner.counters.episodes
        while self._frames < frames and not stopped():
            before = self._frames
            self._episode(episode)
            episode += 1
            if _crossed(before, self._frames, self._config.evaluate_every_frames):
                self._report()
            if _crossed(before, self._frames, self._config.checkpoint_every_frames):
                self._save_if_there_is_room()
        self._save()
        self._progress.write()

    def _episode(self, index: int) -> None:
        observation, verdict = self._environment.reset(index, self._config.condition)
        rewards: list[float] = []
        while True:
            program = self._environment.program
            step = Step(observation, program, verdict, executed=self._agent.last_command)
            trajectory = self._agent.observe(step)
            if trajectory is not None:
                self._transport.send(trajectory)
            if verdict.truncated:
                break
            self._until_it_may_act()
            velocity = self._agent.act().astype(np.float64) * self._max_speed
            observation, verdict = self._environment.step(velocity)
            self._frames += 1
            rewards.append(verdict.reward)
        self._rewards.add(rewards)
        if self._watcher is not None:
            self._watcher.episode(self._frames, len(rewards), float(np.mean(rewards)))

    def _until_it_may_act(self) -> None:
        while self._agent.prepare() is not None:
            self._agent.offer(self._transport.receive())

    def _report(self) -> None:
        self._transport.drain()
        learner = self._learner
        row = {
            "frames": float(self._frames),
            "wall_s": time.monotonic() - self._started,
            "updates": float(learner.counters.updates),
            "behaviour.reward_per_step": self._rewards.mean,
            **{name: learner.metrics().get(name, float("nan")) for name in _FIGURES},
        }
        if self._evaluate is not None:
            actor = Actor(learner.network, learner.config.acting.inference, logic=PRODUCT)
            actor.load(learner.snapshot())
            row |= self._evaluate(actor)
        self._rewards = Rewards()
        try:
            self._progress.add(row)
        except OSError as error:
            log.warning("progress: %s: this row is written with the next row", error)
        except CheckpointError:  # a curve of other columns; what is learned is not lost with it
            self._save()
            raise
        if self._watcher is not None:
            self._watcher.row(row)

    def _save_if_there_is_room(self) -> None:
        """On the way: hours are not given up for what the checkpoint before can make again."""
        try:
            self._save()
        except CheckpointError as error:
            log.warning("%s: learning goes on, and is saved when there is room", error)

    def _save(self) -> None:
        self._transport.drain()
        config = self._config
        about = config.seed, config.design, config.preset, config.arm
        extra = {**self._learning.facts(self._started, *about), **self._rewards.facts}
        save_checkpoint(checkpoint_of(self._config.out), self._learner, extra)


_FIGURES = ("critic_loss", "mean_q", "actor_gradient_norm")


def _make_agent(config: TrainConfig, learning: LearningRun) -> LearningAgent:
    """The agent of the run, or of the run that goes on: it stops and resumes with its learner."""
    learner, first = learning.learner, (AgentKey(config.agent_id, 0), 0)
    accounts = learner.replay.ledger.accounted().items()
    key, sequence = next((one for one in accounts if one[0].agent_id == config.agent_id), first)
    agent = LearningAgent(key, config.seed, sequence)
    info = learning.info
    facts = info.world_digest, info.control_period, info.thresholds, info.reward
    arena = ArenaFacts(*facts)
    agent.follow(info, arena)
    for policy in learning.opening():
        agent.offer(policy)
    return agent


def _crossed(before: int, after: int, every: int) -> bool:
    """Whether a multiple of `every` lies in (before, after]."""
    return every > 0 and after // every > before // every
