"""A custom reward that also pays for coming closer."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pa_ros.world import REWARDS, Reward


@dataclass(frozen=True)
class Shaped(Reward):
    """+1 if the program is satisfied, else −1 plus a bonus that falls with the distance.

    The bonus is `weight` at distance 0 and falls by a factor of e every `length_m`.
    """

    weight: float = 0.5
    length_m: float = 0.3

    def __call__(self, satisfied: Any, measure: Any) -> Any:
        bonus = self.weight * np.exp(
            -np.asarray(measure) / self.length_m
        )  # 0 for an infinite distance
        return np.where(satisfied, 1.0, -1.0 + bonus)


REWARDS.register("shaped", Shaped)
