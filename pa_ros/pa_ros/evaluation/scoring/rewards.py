"""Scores of a policy: reward per step, raw and normalized between two references."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class EpisodeScore:
    """One evaluation episode."""

    episode: int
    program: str
    reward_per_step: float  # mean of the ±1 rewards, in [-1, 1]
    success: bool  # the program was satisfied when the episode ended
    distance: float  # metres, hand to the nearest object the program names, at the end


def rewards(scores: Sequence[EpisodeScore]) -> NDArray[np.float64]:
    """Reward per step of each episode, [E]."""
    return np.array([score.reward_per_step for score in scores], dtype=np.float64)


def normalized(raw: float, low: float, high: float) -> float:
    """0 at the random reference, 1 at the scripted one (same episodes); nan if they coincide."""
    return (raw - low) / (high - low) if high != low else float("nan")
