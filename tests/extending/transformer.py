"""A custom family of networks: a Transformer over the objects, which knows p of each."""

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import FAMILIES, DetectorFamily, Tensors
from pa_ros.networks.programmable import Detectors, Programs

HEADS = 2  # `hidden` is a multiple of it


class Encoder(Detectors):
    """From Ω and programs to h: objects attend to one another, then are weighed by p."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        hidden = config.hidden
        self.enter = nn.Linear(config.world.columns + 1, hidden)
        self.layer = nn.TransformerEncoderLayer(hidden, HEADS, hidden, 0.0, batch_first=True)

    def trunk(self, objects: Tensor, arm: Tensor, programs: Programs, hand_index: int) -> Tensor:
        """h [B, K, H] of objects [B, N, F] and arm [B, A] under K programs each."""
        p = programs.relevant_objects(self.phi(objects, arm), hand_index, self.logic)  # [B, K, N]
        columns = self.columns(objects, arm) * self.seen
        columns = columns[:, None].expand(-1, p.shape[1], -1, -1)  # [B, K, N, F + A]
        x = self.enter(torch.cat([columns, p[..., None]], -1)).flatten(0, 1)
        x = self.layer(x).unflatten(0, p.shape[:2])  # [B, K, N, H]
        h: Tensor = (p[..., None] * x).sum(2)
        return h


class Actor(Encoder):
    """a = tanh(Linear(h))."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.output = nn.Linear(config.hidden, config.world.actions)

    def forward(
        self, objects: Tensor, arm: Tensor, programs: Programs, hand_index: int = 0
    ) -> Tensor:
        """Actions in [-1, 1], [B, K, J]."""
        return torch.tanh(self.output(self.trunk(objects, arm, programs, hand_index)))


class Critic(Encoder):
    """Q = Linear(tanh(h + Linear(a)))."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.action = nn.Linear(config.world.actions, config.hidden)
        self.output = nn.Linear(config.hidden, 1)

    def head(self, h: Tensor, action: Tensor) -> Tensor:
        """Q [B, K] of h and an action per scene [B, J] or per program [B, K, J]."""
        action = action if action.dim() == 3 else action[:, None]
        q: Tensor = self.output(torch.tanh(h + self.action(action)))
        return q.squeeze(-1)


class Transformer(DetectorFamily):
    """The tensors' shapes are those of the modules."""

    def modules(self) -> tuple[type[Any], type[Any]]:
        return Actor, Critic

    def initial(self, config: NetworkConfig, critic: bool, rng: np.random.Generator) -> Tensors:
        """Those of the modules, but actions are small at first."""
        tensors = super().initial(config, critic, rng)
        if not critic:
            tensors["output.weight"] *= 0.01
        return tensors


FAMILIES.register("transformer", Transformer())
