"""Agents as a user meets them: train one, load one, act with it, see what it understands."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pa_ros.acting.executing import Actor
from pa_ros.acting.insight import Explanation, Insight
from pa_ros.arena import ArenaChoice, ArenaConfig, Design, design_named, training_programs
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float64, Observation, PolicySnapshot
from pa_ros.evaluation.conditions import RANDOM_WEIGHTS
from pa_ros.evaluation.evaluate import AgentPolicy, TrainingScores, policy_of
from pa_ros.language import MIN_MAX, Logic, Program, parse
from pa_ros.learning.checkpoint_files import SHIPPED_PREFIX, find_checkpoint, newest_whole
from pa_ros.learning.checkpoints import load_policy, read_metadata
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.folder import checkpoint_of
from pa_ros.learning.interfaces import Evaluate, Log, Watcher
from pa_ros.learning.learner import Learner
from pa_ros.learning.loop import train
from pa_ros.learning.recipes import LearningSettings
from pa_ros.networks.config import actor_config
from pa_ros.networks.parameters import initial_actor
from pa_ros.perception import TOLD, VIEWS, calibrated, task_seen
from pa_ros.world import Reward

RANDOM_WEIGHTS_STREAM = 4  # 0 arena, 1 exploration, 2 learner, 3 the random reference


@dataclass(frozen=True)
class TrainedAgent:
    """An actor's weights, the design and arena they were trained in, and the logic they act by."""

    snapshot: PolicySnapshot
    design: Design
    arena: ArenaConfig
    logic: Logic = MIN_MAX
    perception: str = ""  # calibration of the camera it sees with; empty: properties are told

    def act(self, observation: Observation, program: str | Program) -> Float64:
        """Joint velocities [J], rad/s, that pursue a program from an observation of an arena.

        Raises ProgramError for a wrong text, ActingError for the observation of another arm or
        design.
        """
        return self.policy(observation, self._parsed(program))

    def explain(self, observation: Observation, program: str | Program = "") -> Explanation:
        """Φ and p of the objects: what each word and the program mean to the agent here.

        Raises ConfigError if the networks evaluate no programs.
        """
        parsed = self._parsed(program) if program else None
        return Insight(self.snapshot, self.logic).explain(observation, parsed)

    def _parsed(self, program: str | Program) -> Program:
        return parse(program, self.design.vocabulary) if isinstance(program, str) else program

    @cached_property
    def policy(self) -> AgentPolicy:
        """The greedy policy."""
        return greedy(self.snapshot, self.arena, self.logic)

    @property
    def digest(self) -> str:
        """12 hexadecimal digits of the architecture and the weights."""
        content = hashlib.sha256(self.snapshot.architecture.encode())
        for name, tensor in sorted(self.snapshot.tensors.items()):
            content.update(name.encode() + np.ascontiguousarray(tensor).tobytes())
        return content.hexdigest()[:12]

    @property
    def key(self) -> str:
        """Identifies what actions follow from: weights, logic, the camera's calibration.

        Not the rules of executing: scores under older rules have the same key."""
        key = f"{self.digest}-{self.logic.name}-{self.logic.sharpness:g}"
        if self.perception:
            key += f"-{hashlib.sha256(self.perception.encode()).hexdigest()[:12]}"
        return key


def load_agent(
    path: str | Path,
    design: str | None = None,
    preset: str | None = None,
    arm: str | None = None,
    logic: Logic = MIN_MAX,
) -> TrainedAgent:
    """Load the agent of a checkpoint or of a training run's folder.

    Design, preset and arm are those of its training unless given. Raises ConfigError if neither
    says them.
    """
    folder = find_checkpoint(Path(path))  # once: a running learner may replace the latest
    facts = read_metadata(folder)["extra"]
    given = {"design": design, "preset": preset, "arm": arm}
    named: dict[str, Any] = {name: value or facts.get(name) for name, value in given.items()}
    if missing := [name for name, value in named.items() if not isinstance(value, str)]:
        raise ConfigError(f"agent {path}: expected {missing} in the checkpoint or as options")
    arena = ArenaChoice(**named).arena_config()
    snapshot = load_policy(folder)
    asked = actor_config(snapshot.architecture).vocabulary.relations
    task = design_named(named["design"]).with_relations(*asked)
    return TrainedAgent(snapshot, task, arena, logic, str(facts.get("perception", "")))


def checkpoint_named(agent: str | Path) -> Path:
    """The checkpoint of an agent: a path, or the name of one of the package's own ("3-D")."""
    text = str(agent)
    is_path = "/" in text or text.startswith(SHIPPED_PREFIX) or Path(agent).exists()
    return Path(agent) if is_path else Path(f"{SHIPPED_PREFIX}{agent}")


def greedy(snapshot: PolicySnapshot, arena: ArenaConfig, logic: Logic = MIN_MAX) -> AgentPolicy:
    """An actor without exploration, as a policy of joint velocities (rad/s) for an arena."""
    actor = Actor.of(snapshot, logic)
    return policy_of(actor, actor.network.world, arena)


def without_training(agent: TrainedAgent, seed: int) -> TrainedAgent:
    """The same networks with random weights (paper, condition `random`).

    All layers are uniform in ±1/√fan-in, also the last one and the detectors, which training starts
    smaller: with those the arm would hardly move.
    """
    config = actor_config(agent.snapshot.architecture)
    plain = config.changed(actor_output_scale=config.hidden**-0.5, detector_init_scale=1.0)
    rng = np.random.default_rng([seed, RANDOM_WEIGHTS_STREAM])
    snapshot = replace(agent.snapshot, version=0, tensors=initial_actor(plain, rng))
    return replace(agent, snapshot=snapshot)


def acting_under(condition: str, agent: TrainedAgent, seed: int) -> tuple[TrainedAgent, str]:
    """The agent that acts under a condition, and the condition of its episodes."""
    if condition == RANDOM_WEIGHTS:
        return without_training(agent, seed), "train"
    return agent, condition


def camera_of(run: Path | None, arena: ArenaConfig, design: Design, perception: str = TOLD) -> str:
    """The calibration of the camera that a run sees through (`perception.VIEWS`); "" for TOLD.

    A resumed run keeps its own camera; `run` is its folder. ConfigError if another is asked for.
    """
    if run is None:
        return calibrated(arena, design, perception)
    newest, _ = newest_whole(checkpoint_of(run))
    kept = str(read_metadata(newest)["extra"].get("perception", ""))
    views = [json.loads(camera)["view"] for camera in kept.splitlines()]
    own = next((name for name, one in VIEWS.items() if one == views), TOLD)
    if perception not in (TOLD, own):
        raise ConfigError(f"perception: expected {own}, as the resumed run has, got {perception}")
    return kept


def train_agent(
    arena: ArenaConfig,
    design: Design,
    learning: LearningSettings,
    config: TrainConfig,
    reward: Reward | None = None,
    scores: Evaluate | None = None,
    perception: str = "",
    resume: bool = False,
    run_log: Log | None = None,
    watcher: Watcher | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Learner:
    """Train in one process; see `pa_ros.learning.loop.train` for what is left and raised.

    :param reward: None: the paper's ±1.
    :param scores: None: greedy scores on training and held-out programs.
    :param perception: calibration of a camera; empty: properties are told.
    """
    task = task_seen(arena, design, config.seed, perception, reward)
    names = {"design": design.name, "preset": arena.preset, "arm": arena.arm}
    if perception:
        names["perception"] = perception
    return train(
        config.changed(environment=names),
        learning.network.for_world(task.world),
        learning.learner,
        task,
        np.array(arena.command_limits),
        training_programs(design),
        scores or TrainingScores(arena, design, config.evaluation_episodes, perception),
        resume,
        run_log,
        watcher,
        stopped,
    )
