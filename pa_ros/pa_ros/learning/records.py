"""The files of a run in one process: a learning curve and checkpoints."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from typing import Any

from pa_ros.learning.checkpoint_files import make_latest, newest_whole
from pa_ros.learning.checkpoints import check_facts, read_metadata, restore, save_checkpoint
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.folder import checkpoint_of
from pa_ros.learning.learner import Learner
from pa_ros.learning.progress import ProgressLog
from pa_ros.learning.run import LearningRun

log = logging.getLogger(__name__)

FIGURES = ("critic_loss", "mean_q", "actor_gradient_norm")  # of the learner, in each row


def resume_from(config: TrainConfig, learner: Learner) -> dict[str, Any]:
    """Restore the learner of the same run; returns the other values that its checkpoint holds.

    Raises CheckpointError if the folder has no checkpoint, or one of another run's settings.
    """
    path, damage = newest_whole(checkpoint_of(config.out))
    if damage:
        log.warning(damage)
        make_latest(path)
    check_facts(path, read_metadata(path), seed=config.seed, **config.environment)
    return restore(path, learner)


class Records:
    """Writes progress.csv and checkpoints."""

    def __init__(self, config: TrainConfig, run: LearningRun, resumed: Mapping[str, Any]) -> None:
        """`resumed`: values from the checkpoint that the run resumes from; empty: a new run."""
        self._config, self._run = config, run
        self._reward_sum: float = resumed.get("reward_sum", 0.0)  # since the last row
        self._reward_steps: int = resumed.get("reward_steps", 0)
        self._started = time.monotonic() - resumed.get("wall_s", 0.0)
        frames = run.learner.counters.frames if resumed else None
        self._progress = ProgressLog(config.out / "progress.csv", frames)

    def add_rewards(self, rewards: Sequence[float]) -> None:
        """Add an episode's, one by one: a run that was stopped and resumed has the same sum."""
        for reward in rewards:
            self._reward_sum += reward
        self._reward_steps += len(rewards)

    def row(self, frames: int) -> dict[str, float]:
        """How learning went since the last row, by column; the learner must be idle."""
        metrics = self._run.learner.metrics()
        reward_per_step = self._reward_sum / self._reward_steps
        self._reward_sum, self._reward_steps = 0.0, 0
        return {
            "frames": float(frames),
            "wall_s": time.monotonic() - self._started,
            "updates": float(metrics["updates"]),
            "behaviour.reward_per_step": reward_per_step,
            **{name: metrics.get(name, float("nan")) for name in FIGURES},
        }

    def add(self, row: Mapping[str, float]) -> None:
        """Append a row to progress.csv. If the disk is full, it is written with the next row."""
        try:
            self._progress.add(row)
        except OSError as error:
            log.warning("progress: %s: this row is written with the next row", error)

    def save(self) -> None:
        """Write a checkpoint; the learner must be idle. CheckpointError if there is no room."""
        config = self._config
        extra = self._run.facts(self._started, config.seed, **config.environment)
        extra |= {"reward_sum": self._reward_sum, "reward_steps": self._reward_steps}
        save_checkpoint(checkpoint_of(config.out), self._run.learner, extra)

    def save_if_there_is_room(self) -> None:
        """Write a checkpoint if possible: a full disk must not end a run of hours."""
        try:
            self.save()
        except CheckpointError as error:
            log.warning("%s: learning continues, and is saved when there is room", error)

    def finish(self) -> None:
        """Write the last checkpoint, and rows that had no room before."""
        self.save()
        self._progress.write()
