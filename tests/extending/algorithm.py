"""A custom algorithm: critic-regularized regression (Wang et al. 2020).

The critic learns like DPG's. The actor imitates stored actions, with more weight on those that the
critic prefers to the actor's own.
"""

from typing import ClassVar

import numpy as np
import torch
from pydantic import Field
from torch import Tensor
from torch.nn import functional as F

from pa_ros.core.update import Engine
from pa_ros.learning.algorithms import ALGORITHMS, Algorithm
from pa_ros.learning.algorithms.dpg.builder import initial_networks
from pa_ros.learning.algorithms.torch_engine import Inputs, TorchEngine
from pa_ros.learning.config import LearnerConfig
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import Tensors
from pa_ros.world.programs import ProgramTable


class CRRConfig(LearnerConfig):
    """The settings of this algorithm, besides those that all algorithms share."""

    ALGORITHM: ClassVar[str] = "crr"

    temperature: float = Field(
        0.1, gt=0, description="of Q; a lower one prefers better actions more sharply"
    )
    largest_weight: float = Field(20.0, gt=0, description="of one transition")


class TorchCRR(TorchEngine):
    """One update; targets are copied at the end of each episode, like DPG's."""

    def __init__(
        self,
        network: NetworkConfig,
        config: CRRConfig,
        table: ProgramTable,
        initial: dict[str, Tensors],
    ) -> None:
        super().__init__(network, config, table, initial)
        self._temperature, self._largest = config.temperature, config.largest_weight

    def step(self, x: Inputs) -> tuple[Tensor, Tensor]:
        actor, critic = self.networks["actor"], self.networks["critic"]
        h = self.features(critic, x.now)  # [B, K, H]
        q, action = critic.head(h, x.action), self.act(actor, x.now)  # [B, K], [B, K, 6]
        with torch.no_grad():
            then = self.features(self.targets["critic"], x.then)
            following = self.targets["critic"].head(then, self.act(self.targets["actor"], x.then))
            advantage = q - critic.head(h, action)
            weight = (advantage / self._temperature).exp().clamp(max=self._largest)
        loss = F.mse_loss(q, x.reward + x.discount[:, None] * following)
        imitation = (weight * (action - x.action[:, None]).square().mean(-1)).mean()
        self.descend("critic", loss)
        self.descend("actor", imitation)
        return loss.detach(), q.detach().mean()


def make_engine(
    network: NetworkConfig, config: CRRConfig, table: ProgramTable, rng: np.random.Generator
) -> Engine:
    """An engine with random initial weights."""
    return TorchCRR(network, config, table, initial_networks(network, config, rng))


# The recipe `ours` has more exploration noise, so better actions are preferred less sharply.
VALUES = {"ours": {"learner.temperature": 0.2}}
ALGORITHMS.register("crr", Algorithm(CRRConfig, make_engine, VALUES))
