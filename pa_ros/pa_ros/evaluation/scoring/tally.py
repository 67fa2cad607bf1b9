"""Scores of episodes as their verdicts stream past, and the target that ends a demonstration."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from pa_ros.core.experience import Verdict
from pa_ros.core.settings import Settings
from pa_ros.evaluation.scoring.rewards import normalized


@dataclass(frozen=True, slots=True)
class StreamedEpisode:
    """One whole episode, watched from its reset to its time limit."""

    frames: int  # training control steps watched so far, its own included
    held_out: bool  # greedy, under the evaluation condition
    reward_per_step: float
    success: bool  # satisfied at its end


class EpisodeTally:
    """Cuts a stream of verdicts into whole episodes; repeated and late verdicts are ignored."""

    def __init__(self) -> None:
        self.frames = 0  # control steps of training episodes
        self.episodes: list[StreamedEpisode] = []
        self._latest_ns = -1
        self._rewards: list[float] | None = None  # None: this episode's beginning was not seen

    def observe(self, verdict: Verdict, evaluation: bool) -> StreamedEpisode | None:
        """Take in one verdict; the episode that it completes, if it does."""
        if verdict.stamp_ns <= self._latest_ns:
            return None
        self._latest_ns = verdict.stamp_ns
        if verdict.step == 0:
            self._rewards = []
            return None
        self.frames += not evaluation
        if self._rewards is None:
            return None
        self._rewards.append(verdict.reward)
        if not verdict.truncated:
            return None
        mean, self._rewards = float(np.mean(self._rewards)), None
        episode = StreamedEpisode(self.frames, evaluation, mean, verdict.satisfied)
        self.episodes.append(episode)
        return episode

    def latest(self, held_out: bool, count: int) -> list[StreamedEpisode]:
        """The last `count` episodes of a kind."""
        return [episode for episode in self.episodes if episode.held_out == held_out][-count:]

    def curve(self, bins: int = 60) -> tuple[list[float], list[float], list[float]]:
        """Frames, training and held-out reward per step, means over equal spans of frames.

        NaN where a span has no episode of a kind. Empty lists before the first episode.
        """
        if not self.episodes:
            return [], [], []
        edges = np.linspace(0, max(self.frames, 1), bins + 1)
        kinds = [
            [_mean_between(self.episodes, kind, low, high) for low, high in pairwise(edges)]
            for kind in (False, True)
        ]
        return edges[1:].tolist(), kinds[0], kinds[1]


class HeldOutTarget(Settings):
    """When held-out programs count as learned: over the last `episodes` of them."""

    SECTION: ClassVar[str] = "target"

    random: float = Field(description="reward per step of the lower reference, same condition")
    scripted: float = Field(description="of the upper one")
    episodes: int = Field(40, ge=1, description="watched")
    normalized: float = Field(0.9, description="score to reach")
    success: float = Field(0.95, ge=0, le=1, description="share that ends satisfied")

    @model_validator(mode="after")
    def _references_differ(self) -> Self:
        if not self.random < self.scripted:
            raise ValueError(
                f"random: expected less than the scripted reference, got {self.random} and "
                f"{self.scripted}"
            )
        return self

    def score(self, tally: EpisodeTally) -> tuple[float, float]:
        """Normalized score and success rate of the latest held-out episodes; NaN before any."""
        latest = tally.latest(True, self.episodes)
        if not latest:
            return float("nan"), float("nan")
        raw = float(np.mean([episode.reward_per_step for episode in latest]))
        success = float(np.mean([episode.success for episode in latest]))
        return normalized(raw, self.random, self.scripted), success

    def reached(self, tally: EpisodeTally) -> bool:
        """Whether enough held-out episodes were watched and both bounds hold."""
        if len(tally.latest(True, self.episodes)) < self.episodes:
            return False
        score, success = self.score(tally)
        return score >= self.normalized and success >= self.success


def _mean_between(
    episodes: list[StreamedEpisode], held_out: bool, low: float, high: float
) -> float:
    values = [
        episode.reward_per_step
        for episode in episodes
        if episode.held_out == held_out and low < episode.frames <= high
    ]
    return float(np.mean(values)) if values else float("nan")
