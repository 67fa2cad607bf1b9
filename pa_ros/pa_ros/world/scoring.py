"""Is a program satisfied, by how much, and what does that earn? The only place that says so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64
from pa_ros.world.reward import Reward, Sparse


class Score(NamedTuple):
    """The verifier's word on states, each [...], or on one, as numbers."""

    measure: Any  # m, from the hand to the nearest object named; inf if none is
    satisfied: Any
    reward: Any


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
        squares = _square(*np.moveaxis(objects[..., :3].astype(np.float64), -1, 0))
        nearest: Float64 = np.array(inf)
        for i in range(objects.shape[-2]):  # few: faster than to reduce a short axis
            nearest = np.minimum(nearest, np.where(named[..., i], squares[..., i], inf))
        return self._judge(np.sqrt(nearest))

    def of_targets(self, targets: Sequence[int], objects: Float32) -> Score:
        """Score one state, [N, 16], given the numbers of the objects named: the same bits in a
        tenth of the time, as numbers."""
        nearest = inf
        for i in targets:
            nearest = min(nearest, _square(*objects[i, :3].tolist()))
        return self._judge(sqrt(nearest))

    def _judge(self, measure: Any) -> Score:
        satisfied = measure <= self.near_threshold_m
        return Score(measure, satisfied, self.reward(satisfied, measure))


def _square(x: Any, y: Any, z: Any) -> Any:
    """Squared distance (m²) from the hand, where positions in Ω begin: of numbers, or arrays."""
    return x * x + y * y + z * z
