"""Scores of episodes, and bootstrap intervals of their means over seeds and episodes.

Seeds and episodes are resampled independently, with replacement: every seed is scored on the same
episodes, so this is a bootstrap of a crossed design. With one seed, only episodes are resampled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95
RESAMPLES = 2000

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class EpisodeScore:
    """One evaluation episode."""

    episode: int
    program: str
    reward_per_step: float  # mean of the ±1 rewards, in [-1, 1]
    success: bool  # the program was satisfied when the episode ended
    distance: float  # in the relation's unit, of the nearest two objects to be related, at the end
    ever: bool = False  # the program was satisfied at some step
    stage: int = 0  # of a goal over time: which of its programs was pursued at the end
    violated: bool = False  # of a goal over time: what is to be avoided was near


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean with its bootstrap confidence interval (95 %, percentile)."""

    mean: float
    low: float
    high: float


def rewards(scores: Sequence[EpisodeScore]) -> Float:
    """Reward per step of each episode, [E]."""
    return np.array([score.reward_per_step for score in scores], dtype=np.float64)


def normalized(raw: float, low: float, high: float) -> float:
    """0 at the random reference, 1 at the scripted one (same episodes); nan if they coincide."""
    return (raw - low) / (high - low) if high != low else float("nan")


def mean_interval(values: Float) -> Interval:
    """The interval of the mean of independent values [E]."""
    weights = _weights(len(values), np.random.default_rng(0))
    return _interval(float(values.mean()), weights @ values / len(values))


def normalized_interval(scores: Float, random: Float, scripted: Float) -> Interval:
    """Mean normalized score of `scores` [S, E] between the references [E] on the same episodes."""
    return gain_over(scores, random, random, scripted)


def gain_over(scores: Float, other: Float, random: Float, scripted: Float) -> Interval:
    """How much higher `scores` [S, E] are than a reference `other` [E], in normalized units.

    (scores − other) / (scripted − random), each a mean over the resampled episodes. Resamples in
    which the references coincide are left out; nan if they always do.
    """
    seeds, episodes = scores.shape
    gains, span = scores - other, scripted - random  # [S, E], [E]
    rng = np.random.default_rng(0)
    seed_weights, weights = _weights(seeds, rng), _weights(episodes, rng)
    gain = ((seed_weights @ gains) * weights).sum(1) / seeds  # [R]
    spans = weights @ span  # [R]
    # A resample of few episodes can make both references equal; it has no scale.
    kept = spans != 0.0
    if not kept.any():
        return Interval(*[float("nan")] * 3)
    mean = normalized(float(gains.mean()), 0.0, float(span.mean()))
    return _interval(mean, gain[kept] / spans[kept])


def _weights(count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """How often each of `count` is drawn in each resample, [R, count]."""
    return rng.multinomial(count, [1 / count] * count, size=RESAMPLES)


def _interval(mean: float, resampled: Float) -> Interval:
    tail = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(resampled, [tail, 100 - tail])
    return Interval(mean, float(low), float(high))
