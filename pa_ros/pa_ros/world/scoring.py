"""Is a program satisfied, by how much, and what does that earn? The only place that says so."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64
from pa_ros.world.reward import Reward, Sparse


class Score(NamedTuple):
    """The verifier's word on states, each [...]."""

    measure: Float64  # m, from the hand to the nearest object named; inf if none is
    satisfied: NDArray[np.bool_]
    reward: Float64


@dataclass(frozen=True)
class Scoring:
    """One arena's rule: NEAR holds at a distance of at most the threshold (paper, section 3)."""

    near_threshold_m: float = 0.20
    reward: Reward = field(default_factory=Sparse)

    def __post_init__(self) -> None:
        if not (isfinite(self.near_threshold_m) and self.near_threshold_m > 0):
            raise ConfigError(
                f"near_threshold: expected a positive number, got {self.near_threshold_m}"
            )

    def __call__(self, named: NDArray[np.bool_], objects: Float32) -> Score:
        """Score states [..., N, 16] under programs of which it is known what they name, [..., N].

        Both are broadcast: `named` [P, N] and `objects` [T, 1, N, 16] give scores [T, P]. The hand
        is never named (`world.programs.crisp`, `language.satisfying`).
        """
        measure = np.minimum.reduce(np.where(named, hand_distances(objects), inf), axis=-1)
        satisfied = measure <= self.near_threshold_m
        return Score(measure, satisfied, self.reward(satisfied, measure))


def hand_distances(objects: Float32) -> Float64:
    """Distance (m) from the hand to each object's center, [..., N]: the norm of its position in Ω.

    In float64 of the float32 features, squares added in the order x, y, z: the same bits for one
    state and for many.
    """
    squares = objects[..., :3].astype(np.float64)
    squares *= squares
    return np.asarray(np.sqrt(squares[..., 0] + squares[..., 1] + squares[..., 2]))
