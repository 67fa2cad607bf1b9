"""A custom algorithm that sees more than s and s': DPG with returns of several steps."""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from pa_ros.core.update import Batch
from pa_ros.learning.algorithms import ALGORITHMS, Algorithm
from pa_ros.learning.algorithms.dpg.builder import initial_networks
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.algorithms.dpg.learner import TorchDPG


class ReturnsConfig(DPGConfig):
    """The settings of this algorithm."""

    ALGORITHM: ClassVar[str] = "returns"

    steps: int = Field(3, ge=1, description="of a return")


class Returns(TorchDPG):
    """DPG whose target is r + γ r' + … + γⁿ Q(s⁽ⁿ⁾), up to the end of the trajectory."""

    steps = 1
    learner: Any = None

    def attach(self, learner: Any) -> None:
        self.learner = learner

    def update(self, batch: Batch) -> None:
        replay, rows = self.learner.replay, np.asarray(batch.rows)
        reward, discount = batch.reward.copy(), batch.discount.copy()
        for _ in range(self.steps - 1):
            later = replay.following(rows)
            goes_on = (discount > 0) & ~replay.arrays["last"][later]
            more = discount[:, None] * self.learner.rewards(later, batch.program)
            reward += np.where(goes_on[:, None], more, 0).astype(np.float32)
            terminal = replay.arrays["terminal"][later]
            shrunk = discount * np.where(terminal, 0, self._config.updates.discount)
            discount = np.where(goes_on, shrunk, discount).astype(np.float32)
            rows = np.where(goes_on, later, rows)
        end = replay.following(rows)
        after = {
            "next_objects": replay.arrays["objects"][end],
            "next_arm": replay.arrays["arm"][end],
        }
        super().update(replace(batch, reward=reward, discount=discount, **after))


def make_engine(network: Any, config: Any, table: Any, rng: Any) -> Returns:
    """An engine with random initial weights."""
    engine = Returns(network, config, table, *initial_networks(network, config, rng).values())
    engine.steps = config.steps
    return engine


ALGORITHMS.register("returns", Algorithm(ReturnsConfig, make_engine))
