"""The greedy scores that a training run reports on the way."""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np

from pa_ros.arena import ArenaConfig, Design, ReachTask
from pa_ros.core.experience import Float32, Observation
from pa_ros.evaluation.scoring.evaluate import REFERENCES, reference_scores, run_episodes
from pa_ros.evaluation.scoring.rewards import normalized, rewards
from pa_ros.language import Program


class Acts(Protocol):
    """Something greedy."""

    def act(self, observation: Observation, program: Program) -> Float32:
        """The action, [J] in [-1, 1]."""


EVALUATION_SEED = 1_000_003  # apart from every training seed's episodes


class TrainingScores:
    """Greedy scores of an actor on the training and the held-out programs.

    The episodes are fixed (by EVALUATION_SEED) and apart from the training ones; the references
    on them are computed once, when first asked for.
    """

    def __init__(self, config: ArenaConfig, design: Design, episodes: int) -> None:
        self._task = ReachTask(config, design, EVALUATION_SEED)
        self._speeds = np.array(config.joint_speed_limits)
        self._episodes = episodes
        self._conditions = ("train", "eval") if design.held_out else ("train",)

    @property
    def task(self) -> ReachTask:
        """Whose episode is being scored."""
        return self._task

    @cached_property
    def _references(self) -> dict[str, list[float]]:
        """The mean reward of each of REFERENCES, by condition."""
        return {
            condition: [
                float(rewards(reference_scores(self._task, name, condition, self._episodes)).mean())
                for name in REFERENCES
            ]
            for condition in self._conditions
        }

    def __call__(self, actor: Acts) -> dict[str, float]:
        """`{train,eval}_greedy.{reward_per_step,normalized,success_rate}`."""
        row: dict[str, float] = {}
        for condition in self._conditions:
            scores = list(
                run_episodes(
                    self._task,
                    lambda o: actor.act(o, self._task.program).astype(np.float64) * self._speeds,
                    condition,
                    self._episodes,
                )
            )
            raw = float(rewards(scores).mean())
            scripted, random = self._references[condition]
            row[f"{condition}_greedy.reward_per_step"] = raw
            row[f"{condition}_greedy.normalized"] = normalized(raw, random, scripted)
            row[f"{condition}_greedy.success_rate"] = float(np.mean([s.success for s in scores]))
        return row
