"""Scores of agents and references on the same episodes, computed once and kept in files."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from laboratory.studies.tables import read_rows, write_rows
from pa_ros.agents import TrainedAgent
from pa_ros.arena import ArenaConfig, Design, ReachTask, scoring_of
from pa_ros.core import __version__
from pa_ros.core.experience import Float64, Observation
from pa_ros.evaluation.blind import BLIND, blind_policy
from pa_ros.evaluation.evaluate import EPISODES_SEED, pursuing, reference_policy, run_episodes
from pa_ros.evaluation.scores import EpisodeScore, normalized, rewards
from pa_ros.perception import task_seen

MakePolicy = Callable[[], Callable[[Observation], Float64]]


@dataclass(frozen=True)
class Benchmark:
    """The same episodes 0 … `episodes` − 1 of every condition of a design, in one arena."""

    design: Design
    arena: ArenaConfig
    episodes: int = 100  # in each condition
    seed: int = EPISODES_SEED

    @property
    def digest(self) -> str:
        """12 hexadecimal digits of the settings that scores of given weights depend on.

        The code of an extension (an arm, a relation) is not part of it.
        """
        # The version is part of it, because a release may change physics or scoring.
        content = repr((self, scoring_of(self.arena, self.design).thresholds, __version__))
        return hashlib.sha256(content.encode()).hexdigest()[:12]


class Scorer:
    """Scores policies on a benchmark and keeps each condition's scores in a file under `cache`.

    An interrupted study resumes from these files, and references are computed once for all agents.
    After a change to an extension's code, delete `cache`.
    """

    def __init__(self, benchmark: Benchmark, cache: Path) -> None:
        self.benchmark = benchmark
        self._cache = cache / benchmark.digest
        self._tasks: dict[str, ReachTask] = {}

    def _task(self, perception: str = "") -> ReachTask:
        of = self.benchmark
        if perception not in self._tasks:
            self._tasks[perception] = task_seen(of.arena, of.design, of.seed, perception)
        return self._tasks[perception]

    def reference(self, name: str, condition: str) -> list[EpisodeScore]:
        """Scores of one of `evaluate.REFERENCES` or `blind.BLIND`."""
        task, make = self._task(), blind_policy if name in BLIND else reference_policy
        return self._scores(name, condition, lambda: make(task, name), task)

    def agent(self, agent: TrainedAgent, condition: str) -> list[EpisodeScore]:
        """Scores of a trained agent that acts greedily."""
        task = self._task(agent.perception)
        return self._scores(agent.key, condition, lambda: pursuing(task, agent.policy), task)

    def normalized(self, condition: str, scores: Sequence[EpisodeScore]) -> float:
        """Their mean reward, 0 for random actions and 1 for the script on the same episodes."""
        low, high = (
            float(rewards(self.reference(name, condition)).mean())
            for name in ("random", "scripted")
        )
        return normalized(float(rewards(scores).mean()), low, high)

    def _scores(
        self, name: str, condition: str, policy: MakePolicy, task: ReachTask
    ) -> list[EpisodeScore]:
        path = self._cache / name / f"{condition}.csv"
        if not path.exists():
            episodes = run_episodes(task, policy(), condition, self.benchmark.episodes)
            write_rows(path, list(episodes))
        return read_rows(path, EpisodeScore)
