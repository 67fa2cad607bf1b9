"""The one loop: actor, environment and learner in one process, without ROS.

Over the graph the same objects take the same steps in the same order (docs/DESIGN.md, "The
synchronous protocol"), so the same seed gives the same weights, bit for bit, either way.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from pa_ros.acting.actor import Actor
from pa_ros.acting.agent import LearningAgent
from pa_ros.acting.exploration import ExplorationNoise
from pa_ros.acting.trajectories import TrajectoryBuilder
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float64, Observation, PolicySnapshot, Trajectory, Verdict
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.algorithms.dpg.learner import Learner
from pa_ros.learning.checkpoints import claim, restore, save_checkpoint
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.progress import Progress
from pa_ros.networks.config import NetworkConfig
from pa_ros.world import Scoring

log = logging.getLogger(__name__)

Evaluate = Callable[[Actor], dict[str, float]]
"""Greedy scores of an actor by column name; must not disturb the training environment."""


class Environment(Protocol):
    """What the loop trains on; `pa_ros.arena.ReachTask` is one."""

    @property
    def program(self) -> str:
        """Canonical text of the program that the verifier scores by now."""

    @property
    def scoring(self) -> Scoring:
        """The rule of its rewards, by which the learner relabels."""

    @property
    def control_period_s(self) -> float:
        """Simulation time of one control step."""

    def reset(self, episode_index: int, condition: str) -> tuple[Observation, Verdict]:
        """Begin an episode, fixed by its index."""

    def step(self, joint_velocity: Float64) -> tuple[Observation, Verdict]:
        """Act for one control period, rad/s, [6]."""


class Log(Protocol):
    """Is told what a run does; `pa_ros.bags.run_log.RunLog` records it. Must change nothing."""

    def begin(self, learner: Learner) -> None:
        """Before the first step."""

    def add(self, trajectory: Trajectory, learner: Learner) -> None:
        """After the learner took a trajectory in; on its thread."""


@dataclass(frozen=True)
class TrainConfig:
    """One training run. `design` and `preset` name the environment that the caller builds."""

    out: Path
    seed: int = 0
    frames: int = 100_000
    design: str = "2-L"
    preset: str = "fast"
    condition: str = "train"
    agent_id: str = "agent"
    evaluate_every_frames: int = 10_000  # 0: never; also a row of progress.csv
    checkpoint_every_frames: int = 50_000  # 0: only at the end
    overlap: bool = True  # act while the learner updates, where policy_lag allows; same result

    def __post_init__(self) -> None:
        for name in ("seed", "evaluate_every_frames", "checkpoint_every_frames"):
            if getattr(self, name) < 0:
                raise ConfigError(f"train {name}: expected at least 0, got {getattr(self, name)}")
        if self.frames < 1:
            raise ConfigError(f"train frames: expected at least 1, got {self.frames}")


def train(
    config: TrainConfig,
    network: NetworkConfig,
    learner_config: DPGConfig,
    environment: Environment,
    max_speed: Float64,
    training_programs: Sequence[str],
    evaluate: Evaluate | None = None,
    resume: bool = False,
    run_log: Log | None = None,
) -> Learner:
    """Train for `config.frames` control steps, whole episodes; returns the learner.

    `max_speed` is [6] rad/s: a velocity command is the action times it. Leaves progress.csv and
    `checkpoint/` under `config.out`. With `resume`, goes on from the checkpoint there (raises
    CheckpointError if there is none that fits), and ends where an unbroken run would have. Raises
    FolderInUseError if another run writes into `config.out`.
    """
    with claim(config.out):
        learner = Learner(
            network, learner_config, training_programs, config.seed, environment.scoring
        )
        wall_s = 0.0
        if resume:
            wall_s = _resume(config, learner)
        if run_log is not None:
            run_log.begin(learner)
        run = _Run(config, learner, environment, max_speed, evaluate, wall_s, resume, run_log)
        with run:
            run.until(config.frames)
        return learner


def _resume(config: TrainConfig, learner: Learner) -> float:
    """Restore the learner of the same run; the seconds that it has taken so far."""
    path = config.out / "checkpoint"
    extra = restore(path, learner)
    for name in ("seed", "design", "preset"):
        if extra.get(name) != getattr(config, name):
            raise CheckpointError(
                f"checkpoint: {path}: {name}: expected {getattr(config, name)!r}, "
                f"got {extra.get(name)!r}"
            )
    return float(extra.get("wall_s", 0.0))


class _Consumer:
    """Hands trajectories to the learner, in order, and its versions back."""

    def __init__(self, learner: Learner, overlap: bool, run_log: Log | None) -> None:
        self._learner, self._log = learner, run_log
        self._policies = {snapshot.version: snapshot for snapshot in learner.published}
        self._pending: list[Future[PolicySnapshot]] = []
        self._thread = ThreadPoolExecutor(1, "learner") if overlap else None

    def put(self, trajectory: Trajectory) -> None:
        if self._thread is None:
            self._keep(self._consume(trajectory))
        else:
            self._pending.append(self._thread.submit(self._consume, trajectory))

    def policy(self, version: int) -> PolicySnapshot:
        """Wait for a version; older ones are forgotten."""
        while version not in self._policies:
            self._keep(self._pending.pop(0).result())
        self._policies = {k: v for k, v in self._policies.items() if k >= version}
        return self._policies[version]

    def drain(self) -> None:
        """Wait until every trajectory is consumed: only then may the learner be looked at."""
        while self._pending:
            self._keep(self._pending.pop(0).result())

    def close(self) -> None:
        if self._thread is not None:
            self._thread.shutdown(cancel_futures=True)

    def _consume(self, trajectory: Trajectory) -> PolicySnapshot:
        self._learner.consume(trajectory)
        if self._log is not None:
            self._log.add(trajectory, self._learner)
        return self._learner.snapshot()

    def _keep(self, snapshot: PolicySnapshot) -> None:
        self._policies[snapshot.version] = snapshot


class _Run:
    """One call of `train`."""

    def __init__(
        self,
        config: TrainConfig,
        learner: Learner,
        environment: Environment,
        max_speed: Float64,
        evaluate: Evaluate | None,
        wall_s: float,
        resume: bool,
        run_log: Log | None,
    ) -> None:
        self._config, self._learner = config, learner
        self._environment, self._max_speed = environment, max_speed
        self._evaluate = evaluate
        self._started = time.monotonic() - wall_s
        self._agent = _make_agent(config, learner, environment.control_period_s)
        overlap = config.overlap and learner.config.schedule.policy_lag > 0
        self._consumer = _Consumer(learner, overlap, run_log)
        self._frames = learner.counters.frames
        self._rewards: list[float] = []  # since the last row
        resumed_frames = self._frames if resume else None
        self._progress = Progress(config.out / "progress.csv", resumed_frames)

    def __enter__(self) -> _Run:
        return self

    def __exit__(self, *_: object) -> None:
        self._consumer.close()

    def until(self, frames: int) -> None:
        """Episodes until `frames` steps were taken; then a checkpoint."""
        episode = self._learner.counters.episodes
        while self._frames < frames:
            before = self._frames
            self._episode(episode)
            episode += 1
            if _crossed(before, self._frames, self._config.evaluate_every_frames):
                self._report()
            if _crossed(before, self._frames, self._config.checkpoint_every_frames):
                self._save()
        self._save()

    def _episode(self, index: int) -> None:
        observation, verdict = self._environment.reset(index, self._config.condition)
        while True:
            program = self._environment.program
            trajectory = self._agent.observe(observation, verdict, program)
            if trajectory is not None:
                self._consumer.put(trajectory)
            if verdict.truncated:
                return
            version = self._agent.required_version
            if version is not None:
                self._agent.load(self._consumer.policy(version))
            velocity = self._agent.act().astype(np.float64) * self._max_speed
            observation, verdict = self._environment.step(velocity)
            self._frames += 1
            self._rewards.append(verdict.reward)

    def _report(self) -> None:
        self._consumer.drain()
        learner = self._learner
        row = {
            "frames": float(self._frames),
            "wall_s": time.monotonic() - self._started,
            "updates": float(learner.counters.updates),
            "behaviour.reward_per_step": float(np.mean(self._rewards)),
            **{name: learner.metrics().get(name, float("nan")) for name in _FIGURES},
        }
        if self._evaluate is not None:
            actor = Actor(learner.network, learner.config.acting.inference)
            actor.load(learner.snapshot())
            row |= self._evaluate(actor)
        self._rewards = []
        self._progress.add(row)
        log.info("%s", "  ".join(f"{name} {value:.4g}" for name, value in row.items()))

    def _save(self) -> None:
        self._consumer.drain()
        extra = {
            "wall_s": time.monotonic() - self._started,
            "seed": self._config.seed,
            "design": self._config.design,
            "preset": self._config.preset,
        }
        save_checkpoint(self._config.out / "checkpoint", self._learner, extra)


_FIGURES = ("critic_loss", "mean_q", "actor_gradient_norm")


def _make_agent(config: TrainConfig, learner: Learner, control_period_s: float) -> LearningAgent:
    settings = learner.config.acting
    noise = ExplorationNoise(settings.exploration, control_period_s, config.seed)
    actor = Actor(learner.network, settings.inference, noise)
    sequence = learner.replay.ledger.next_sequence(config.agent_id)
    digest = learner.network.vocabulary.digest
    steps = settings.schedule.trajectory_steps
    builder = TrajectoryBuilder(config.agent_id, steps, digest, sequence)
    return LearningAgent(actor, builder, settings.schedule)


def _crossed(before: int, after: int, every: int) -> bool:
    """Whether a multiple of `every` lies in (before, after]."""
    return every > 0 and after // every > before // every
