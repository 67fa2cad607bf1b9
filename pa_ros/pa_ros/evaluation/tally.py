"""Scores of episodes from a stream of steps, and the target that ends a demonstration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pa_ros.core.experience import Step
from pa_ros.evaluation.scores import normalized


@dataclass(frozen=True, slots=True)
class StreamedEpisode:
    """An episode that was observed from its reset to its time limit."""

    held_out: bool  # greedy, under the evaluation condition
    reward_per_step: float
    success: bool  # satisfied at its end


class EpisodeTally:
    """Cuts a stream of steps into whole episodes. Ignores repeated, late and unjudged ones."""

    def __init__(self) -> None:
        self.frames = 0  # control steps of training episodes
        self.episodes: list[StreamedEpisode] = []
        self._latest_ns = -1
        self._rewards: list[float] | None = None  # None: this episode's start was not observed

    def observe(self, step: Step) -> None:
        """Add one step."""
        observation, verdict = step.observation, step.verdict
        # An arena repeats its last step until it is answered.
        if verdict is None or observation.stamp_ns <= self._latest_ns:
            return
        self._latest_ns = observation.stamp_ns
        # The verdict of a reset rewards no action.
        if observation.step == 0:
            self._rewards = []
            return
        self.frames += not step.evaluation
        if self._rewards is None:
            return
        self._rewards.append(verdict.reward)
        if verdict.truncated:
            mean, self._rewards = float(np.mean(self._rewards)), None
            self.episodes.append(StreamedEpisode(step.evaluation, mean, verdict.satisfied))


@dataclass(frozen=True)
class HeldOutTarget:
    """When held-out programs count as learned: over the last `episodes` of them."""

    random: float  # reward per step of the lower reference on the same condition
    scripted: float  # of the upper reference
    episodes: int = 40
    normalized: float = 0.9  # score to reach
    success: float = 0.95  # share of episodes that end satisfied

    def score(self, tally: EpisodeTally) -> tuple[float, float]:
        """Normalized score and success rate of the latest held-out episodes; NaN before any."""
        latest = self._latest(tally)
        if not latest:
            return float("nan"), float("nan")
        raw = float(np.mean([episode.reward_per_step for episode in latest]))
        success = float(np.mean([episode.success for episode in latest]))
        return normalized(raw, self.random, self.scripted), success

    def reached(self, tally: EpisodeTally) -> bool:
        """Whether enough held-out episodes were observed and both bounds hold."""
        score, success = self.score(tally)
        enough = len(self._latest(tally)) == self.episodes
        return enough and score >= self.normalized and success >= self.success

    def _latest(self, tally: EpisodeTally) -> list[StreamedEpisode]:
        return [episode for episode in tally.episodes if episode.held_out][-self.episodes :]
