"""Intervals of normalized scores over seeds and episodes at once.

Seeds and episodes are resampled independently, with replacement (a bootstrap of a crossed design:
every seed is scored on the same episodes), as `rliable` resamples runs; with one seed, episodes
alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pa_ros.evaluation.scores import CONFIDENCE, RESAMPLES, Interval, normalized

Float = NDArray[np.float64]


def normalized_over_seeds(scores: Float, random: Float, scripted: Float, seed: int = 0) -> Interval:
    """Mean normalized score of `scores` [S, E] between the references [E] on the same episodes."""
    return _interval(scores, random[None], random, scripted, seed)


def gain_over(
    scores: Float, other: Float, random: Float, scripted: Float, seed: int = 0
) -> Interval:
    """How much higher `scores` [S, E] are than a reference `other` [E], in normalized units."""
    return _interval(scores, other[None], random, scripted, seed)


def _interval(scores: Float, base: Float, random: Float, scripted: Float, seed: int) -> Interval:
    """(scores − base) / (scripted − random), each a mean over the resampled episodes.

    Resamples in which the references coincide are left out; nan if they always do.
    """
    seeds, episodes = scores.shape
    gains, span = scores - base, scripted - random  # [S, E], [E]
    rng = np.random.default_rng(seed)
    seed_weights = rng.multinomial(seeds, [1 / seeds] * seeds, size=RESAMPLES)  # [R, S]
    weights = rng.multinomial(episodes, [1 / episodes] * episodes, size=RESAMPLES)  # [R, E]
    gain = ((seed_weights @ gains) * weights).sum(1) / seeds  # [R]
    spans = weights @ span  # [R]
    kept = spans != 0.0
    if not kept.any():
        return Interval(*[float("nan")] * 3)
    tail = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(gain[kept] / spans[kept], [tail, 100 - tail])
    return Interval(
        normalized(float(gains.mean()), 0.0, float(span.mean())), float(low), float(high)
    )
