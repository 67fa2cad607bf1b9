"""Scores of agents and references on the same episodes, computed once and kept."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from pa_ros import __version__
from pa_ros.arena import ARMS, ArenaConfig, Design, ReachTask, conditions_for, scoring_of
from pa_ros.arena.appearance import look_of
from pa_ros.arena.model import mjcf
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float64, Observation
from pa_ros.core.settings import Settings
from pa_ros.evaluation.scoring.agents import TrainedAgent
from pa_ros.evaluation.scoring.blind import BLIND, blind_policy
from pa_ros.evaluation.scoring.evaluate import EPISODES_SEED, reference_scores, run_episodes
from pa_ros.evaluation.scoring.rewards import EpisodeScore
from pa_ros.evaluation.scoring.tables import TableError, read_rows, write_rows
from pa_ros.world.relations import RELATIONS, Relation

PLACES = ((0.3, 0.1, 0.2), (0.4, 0.2, 0.03), (0.3, 0.1, 0.03), (-0.2, 0.4, 0.03), (0.5, -0.3, 0.3))
"""Of a hand, then of objects, m in the base's frame: two relations differ at some, if they do."""

MakePolicy = Callable[[], Callable[[Observation], Float64]]


class Benchmark(Settings):
    """The same episodes 0 … `episodes` − 1 of every condition of a design, in one arena."""

    SECTION: ClassVar[str] = "benchmark"

    design: Design
    arena: ArenaConfig
    episodes: int = Field(100, ge=1, description="in each condition")
    seed: int = Field(EPISODES_SEED, ge=0, description="of the episodes")

    @property
    def digest(self) -> str:
        """12 hexadecimal digits of what the scores of given weights depend on.

        What names stand for counts: arm, blocks and relations as they are here. ConfigError for
        an arm or a look that is none.
        """
        content = repr((self, self._physics(), self._relations(), __version__))
        return hashlib.sha256(content.encode()).hexdigest()[:12]

    def _physics(self) -> tuple[object, ...]:
        """Of the arm and of every block that may be on the table."""
        looks = [look_of(kind) for kind in self.design.extended_pool]
        return ARMS[self.arena.arm].joints, mjcf(self.arena, looks)

    def _relations(self) -> list[tuple[object, ...]]:
        """Of each: threshold, what it measures of some places, where the script sends the hand."""
        return [
            (name, threshold, *_probed(RELATIONS[name], threshold))
            for name, threshold in scoring_of(self.arena, self.design).thresholds.items()
        ]

    def check(self, condition: str) -> None:
        """ConfigError unless the arena knows the condition for this design."""
        known = conditions_for(self.design)
        if condition not in known:
            raise ConfigError(f"benchmark: expected a condition of {known}, got {condition!r}")


def _probed(relation: Relation, threshold: float) -> tuple[list[float], list[float]]:
    """Measures of PLACES for a hand at one of its own, and the goal at the first, rounded."""
    hand, *objects = np.array(PLACES)
    measures = relation.of_places(hand, np.array(objects))
    goal = relation.goal(hand, objects[0], threshold)
    return measures.round(9).tolist(), goal.round(9).tolist()


class Scorer:
    """Scores policies on a benchmark, keeping each condition's scores in a file under `cache`.

    What was interrupted goes on, references are computed once for all agents, and other weights
    or another benchmark never read what is not theirs.
    """

    def __init__(self, benchmark: Benchmark, cache: Path) -> None:
        self.benchmark = benchmark
        self._cache = cache / benchmark.digest
        self._task = ReachTask(benchmark.arena, benchmark.design, benchmark.seed)

    def reference(self, name: str, condition: str) -> list[EpisodeScore]:
        """One of `evaluate.REFERENCES` or `blind.BLIND`."""
        policy = (lambda: blind_policy(self._task, name)) if name in BLIND else None
        return self._kept(name, condition, policy)

    def agent(self, agent: TrainedAgent, condition: str) -> list[EpisodeScore]:
        """A trained agent, acting greedily."""

        def policy() -> Callable[[Observation], Float64]:
            act = agent.policy
            return lambda observation: act(observation, self._task.program)

        return self._kept(agent.key, condition, policy)

    def path(self, name: str, condition: str) -> Path:
        """Where the scores of a reference, or of the agent with that key, are kept."""
        return self._cache / name / f"{condition}.csv"

    def _kept(self, name: str, condition: str, policy: MakePolicy | None) -> list[EpisodeScore]:
        self.benchmark.check(condition)
        path, count = self.path(name, condition), self.benchmark.episodes
        if not path.exists():
            if policy is None:
                scores = list(reference_scores(self._task, name, condition, count))
            else:
                scores = list(run_episodes(self._task, policy(), condition, count))
            write_rows(path, scores)
        kept = read_rows(path, EpisodeScore)
        if [score.episode for score in kept] != list(range(count)):
            raise TableError(
                f"{path}: expected episodes 0 to {count - 1}, got {len(kept)}: it is damaged; "
                "without it they are scored again"
            )
        return kept
