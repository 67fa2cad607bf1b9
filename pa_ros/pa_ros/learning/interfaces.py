"""Interfaces of the training loop: an environment, and optionally an evaluator and a watcher.

`pa_ros.arena.ReachTask` is an environment, `pa_ros.bags.run_log.RunLog` a log.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from pa_ros.acting.executing import Actor
from pa_ros.core.experience import Float64, Observation, PublishedPolicy, Verdict
from pa_ros.language import Program
from pa_ros.learning.run import LearningRun
from pa_ros.world import Scoring, Trajectory

Evaluate = Callable[[Actor], dict[str, float]]
"""Greedy scores of an actor by column name. Must not disturb the training environment."""


class Environment(Protocol):
    """The environment of an agent."""

    @property
    def program(self) -> Program:
        """The program that rewards are for now."""

    @property
    def scoring(self) -> Scoring:
        """The rule of its rewards; the learner relabels by the same rule."""

    @property
    def control_period_s(self) -> float:
        """Simulation time of one control step."""

    def reset(self, episode_index: int, condition: str) -> tuple[Observation, Verdict]:
        """Begin an episode; its index determines all of it."""

    def step(self, joint_velocity: Float64) -> tuple[Observation, Verdict]:
        """Act for one control period, rad/s, [J]."""


class Log(Protocol):
    """Records a run. Must change nothing."""

    def begin(self, run: LearningRun) -> None:
        """Called before the first step."""

    def add(self, trajectory: Trajectory, policy: PublishedPolicy) -> None:
        """Called on the learner's thread after it learned from a trajectory and published."""


class Watcher(Protocol):
    """Shows how far a run is. Must change nothing."""

    def episode(self, frames: int, steps: int, reward: float) -> None:
        """Called after each episode: frames of the run, the episode's steps and mean reward."""

    def row(self, row: Mapping[str, float]) -> None:
        """Called after each evaluation with the row added to progress.csv."""
