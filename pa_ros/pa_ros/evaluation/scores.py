"""Scores of a policy: reward per step, raw and normalized between two references."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap

CONFIDENCE = 0.95
RESAMPLES = 2000


@dataclass(frozen=True, slots=True)
class EpisodeScore:
    """One evaluation episode."""

    episode: int
    program: str
    reward_per_step: float  # mean of the ±1 rewards, in [-1, 1]
    success: bool  # the program was satisfied when the episode ended
    distance: float  # metres, hand to the nearest object the program names, at the end


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean with its bootstrap confidence interval (95 %, percentile, over episodes)."""

    mean: float
    low: float
    high: float


def rewards(scores: Sequence[EpisodeScore]) -> NDArray[np.float64]:
    """Reward per step of each episode, [E]."""
    return np.array([score.reward_per_step for score in scores], dtype=np.float64)


def normalized(raw: float, low: float, high: float) -> float:
    """0 at the random reference, 1 at the scripted one (same episodes); nan if they coincide."""
    return (raw - low) / (high - low) if high != low else float("nan")


def mean_interval(values: NDArray[np.float64], seed: int = 0) -> Interval:
    """Bootstrap interval of the mean; a point when fewer than two distinct values are given."""
    mean = float(values.mean())
    if len(values) < 2 or np.ptp(values) == 0.0:
        return Interval(mean, mean, mean)
    ci = bootstrap(
        (values,),
        np.mean,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return Interval(mean, float(ci.low), float(ci.high))


def normalized_interval(
    policy: NDArray[np.float64],
    random: NDArray[np.float64],
    scripted: NDArray[np.float64],
    seed: int = 0,
) -> Interval:
    """Normalized score with its interval; the three arrays [E] are paired by episode."""

    def statistic(
        p: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64], axis: int = -1
    ) -> NDArray[np.float64]:
        bottom = low.mean(axis=axis)
        score = (p.mean(axis=axis) - bottom) / (high.mean(axis=axis) - bottom)
        return np.asarray(score, dtype=np.float64)

    mean = float(statistic(policy, random, scripted))
    if len(policy) < 2 or np.ptp(policy) + np.ptp(scripted) + np.ptp(random) == 0.0:
        return Interval(mean, mean, mean)
    ci = bootstrap(
        (policy, random, scripted),
        statistic,
        paired=True,
        vectorized=True,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return Interval(mean, float(ci.low), float(ci.high))
