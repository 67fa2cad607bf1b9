"""Canonical actor and critic: MLPs on the flattened Ω, as in Lillicrap et al. 2015.

Paper, appendix "Training parameters": 400 tanh units in each hidden layer, Lillicrap's initial
weights, objects with the same properties always at the same place of the flattened vector. So the
vector has a slot for the hand, then one for each kind of object that the vocabulary has words for,
filled with that block's features or zeros, then the arm, then the target's properties as one-hots
over the vocabulary. Only programs such as NEAR(HAND, AND(color, shape)) have such a target. As in
Lillicrap et al., the action enters the critic at its second hidden layer.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import canonical_inputs, slot_values
from pa_ros.networks.properties import TrueProperties


class FlattenedInput(nn.Module):
    """From Ω and the target's one-hots to the flattened vector, [B, K, D]."""

    slots: Tensor  # [S, groups]: which value of each group
    scales: Tensor  # [F]

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.true = TrueProperties(config.world)
        slots = torch.from_numpy(slot_values(config.world))
        self.register_buffer("slots", slots, persistent=False)
        self.register_buffer("scales", torch.from_numpy(config.input_scales), persistent=False)

    def forward(self, objects: Tensor, arm: Tensor, target: Tensor, hand_index: int) -> Tensor:
        """Flatten objects [B, N, F], arm [B, A] and target one-hots [B, K, V]."""
        has = zip(self.true.has(objects), self.slots.T, strict=True)
        fills = torch.stack([group[..., value] for group, value in has]).all(0)  # [B, N, S]
        scaled = objects * self.scales
        slots = fills.to(scaled).transpose(1, 2) @ scaled  # [B, S, F]
        scene = torch.cat([scaled[:, hand_index], slots.flatten(1), arm], -1)
        scenes = scene[:, None].expand(-1, target.shape[1], -1)
        return torch.cat([scenes, target], -1)


class CanonicalActor(nn.Module):
    """a = tanh(Linear(tanh(Linear(tanh(Linear(x))))))."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        hidden = config.canonical_hidden
        self.flatten = FlattenedInput(config)
        inputs = canonical_inputs(config.world)
        self.layers = nn.ModuleList([nn.Linear(inputs, hidden), nn.Linear(hidden, hidden)])
        self.output = nn.Linear(hidden, config.world.actions)

    def forward(self, objects: Tensor, arm: Tensor, target: Tensor, hand_index: int = 0) -> Tensor:
        """Actions in [-1, 1], [B, K, J], for target one-hots [B, K, V]."""
        x = self.flatten(objects, arm, target, hand_index)
        for layer in self.layers:
            x = torch.tanh(layer(x))
        return torch.tanh(self.output(x))


class CanonicalCritic(nn.Module):
    """Q = Linear(tanh(Linear([tanh(Linear(x)), a])))."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        hidden = config.canonical_hidden
        self.flatten = FlattenedInput(config)
        inputs = canonical_inputs(config.world)
        second = hidden + config.world.actions
        self.layers = nn.ModuleList([nn.Linear(inputs, hidden), nn.Linear(second, hidden)])
        self.output = nn.Linear(hidden, 1)

    def trunk(self, objects: Tensor, arm: Tensor, target: Tensor, hand_index: int) -> Tensor:
        """First hidden layer, [B, K, H], which the action does not enter."""
        return torch.tanh(self.layers[0](self.flatten(objects, arm, target, hand_index)))

    def head(self, h: Tensor, action: Tensor) -> Tensor:
        """Q, [B, K], of `trunk`'s answer and an action per scene [B, J] or program [B, K, J]."""
        if action.dim() == 2:
            action = action[:, None].expand(-1, h.shape[1], -1)
        x = torch.tanh(self.layers[1](torch.cat([h, action], -1)))
        q: Tensor = self.output(x)
        return q.squeeze(-1)  # [B, K]

    def forward(
        self, objects: Tensor, arm: Tensor, target: Tensor, action: Tensor, hand_index: int = 0
    ) -> Tensor:
        """Q, [B, K], for target one-hots [B, K, V]."""
        return self.head(self.trunk(objects, arm, target, hand_index), action)
