"""Train an agent in an arena: the training loop with all that it needs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pa_ros.arena import ArenaConfig, Design, training_programs
from pa_ros.core.errors import ConfigError
from pa_ros.evaluation.evaluate import TrainingScores
from pa_ros.learning.checkpoint_files import newest_whole
from pa_ros.learning.checkpoints import read_metadata
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.folder import checkpoint_of
from pa_ros.learning.interfaces import Evaluate, Log, Watcher
from pa_ros.learning.learner import Learner
from pa_ros.learning.loop import train
from pa_ros.learning.protocols import LearningSettings
from pa_ros.perception import TOLD, VIEWS, calibrated, task_seen
from pa_ros.world import Reward


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
        np.array(arena.joint_speed_limits),
        training_programs(design),
        scores or TrainingScores(arena, design, config.evaluation_episodes, perception),
        resume,
        run_log,
        watcher,
        stopped,
    )
