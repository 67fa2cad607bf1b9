"""Canonical actor and critic: MLPs on the flattened Ω, as in Lillicrap et al. 2015.

Paper, appendix "Training parameters": 400 tanh units in each hidden layer, Lillicrap's initial
weights, objects with the same properties always at the same place of the flattened vector. So the
vector has a slot for the hand, then one for each (shape, color) of the vocabulary that exists in
the world, filled with that block's 16 features or zeros, then the arm, then the target's shape
and color as one-hots over the vocabulary. Only programs NEAR(HAND, AND(color, shape)) have such a
target. As in Lillicrap et al., the action enters the critic at its second hidden layer.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from pa_ros.core.experience import JOINTS
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.slots import canonical_inputs, slot_matrices


class FlattenedInput(nn.Module):
    """From Ω and the target's one-hots to the flattened vector, [B, K, D]."""

    shapes: Tensor  # [16, S]
    colors: Tensor  # [16, S]
    position_scale: Tensor  # [16]

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        for name, matrix in zip(
            ("shapes", "colors"), slot_matrices(config.vocabulary), strict=True
        ):
            self.register_buffer(name, torch.from_numpy(matrix), persistent=False)
        scale = torch.ones(self.shapes.shape[0])
        scale[:3] = config.position_scale
        self.register_buffer("position_scale", scale, persistent=False)

    def forward(self, objects: Tensor, arm: Tensor, target: Tensor, hand_index: int) -> Tensor:
        """Flatten objects [B, N, 16], arm [B, 18] and target one-hots [B, K, V]."""
        fills = (objects @ self.shapes) * (objects @ self.colors)  # [B, N, S]
        scaled = objects * self.position_scale
        slots = fills.transpose(1, 2) @ scaled  # [B, S, 16]
        scene = torch.cat([scaled[:, hand_index], slots.flatten(1), arm], -1)
        scenes = scene[:, None].expand(-1, target.shape[1], -1)
        return torch.cat([scenes, target], -1)


class CanonicalActor(nn.Module):
    """a = tanh(Linear(tanh(Linear(tanh(Linear(x))))))."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        hidden = config.canonical_hidden
        self.flatten = FlattenedInput(config)
        inputs = canonical_inputs(config.vocabulary)
        self.layers = nn.ModuleList([nn.Linear(inputs, hidden), nn.Linear(hidden, hidden)])
        self.output = nn.Linear(hidden, JOINTS)

    def forward(self, objects: Tensor, arm: Tensor, target: Tensor, hand_index: int = 0) -> Tensor:
        """Actions in [-1, 1], [B, K, 6], for target one-hots [B, K, V]."""
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
        inputs = canonical_inputs(config.vocabulary)
        self.layers = nn.ModuleList([nn.Linear(inputs, hidden), nn.Linear(hidden + JOINTS, hidden)])
        self.output = nn.Linear(hidden, 1)

    def trunk(self, objects: Tensor, arm: Tensor, target: Tensor, hand_index: int) -> Tensor:
        """First hidden layer, [B, K, H], which the action does not enter."""
        return torch.tanh(self.layers[0](self.flatten(objects, arm, target, hand_index)))

    def head(self, h: Tensor, action: Tensor) -> Tensor:
        """Q, [B, K], of `trunk`'s answer and an action per scene [B, 6] or program [B, K, 6]."""
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
