"""The paper's formulas in torch as they stand: what one writes first, and what speed is told by.

Batched over transitions and programs, but nothing is rearranged or shared: r is an MLP of every
concatenated pair, its last layer inside the sum, and the critic is evaluated anew for each loss.
It is never chosen for learning; the benchmark and the tests use it.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from pa_ros.core.update import HAND_INDEX, UpdateValues
from pa_ros.learning.algorithms.dpg.torch_engine import Inputs, TorchEngine
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import NOTHING
from pa_ros.networks.programmable import ProgrammableActor, ProgrammableCritic, Programs, Trunk


class _Formulas(Trunk):
    def trunk(self, objects: Tensor, arm: Tensor, programs: Programs, hand_index: int) -> Tensor:
        """h = Σ p_i ω'_i, ω'_i = f(ω_i) + Σ_j α_ij r(ω_i, ω_j) (eq. message-passing), [B, K, H]."""
        n = objects.shape[1]
        arms = arm[:, None, :].expand(-1, n, -1)
        columns = torch.cat([objects * self.position_scale, arms], -1)  # [B, N, 34]
        p = programs.relevant_objects(self.properties(objects, columns), hand_index)  # [B, K, N]
        columns = columns * self.seen
        queries, contexts = self.query(columns)[:, :, None], self.context(columns)[:, None]
        scores = torch.tanh(queries + contexts) @ self.attention.weight  # [B, N, N]
        exponentials = torch.exp(scores) * self.senders(n)
        weights = p[:, :, None, :] * exponentials[:, None]  # [B, K, N, N]
        alpha = weights / weights.sum(-1, keepdim=True).clamp_min(NOTHING)
        receivers = columns[:, :, None].expand(-1, -1, n, -1)
        senders = columns[:, None].expand(-1, n, -1, -1)
        r = _mlp(self.message, torch.cat([receivers, senders], -1))  # [B, N, N, H]
        f = _mlp(self.local, columns)  # [B, N, H]
        omega = f[:, None] + torch.einsum("bkij,bijh->bkih", alpha, r)  # [B, K, N, H]
        return torch.einsum("bki,bkih->bkh", p, omega)


class StraightforwardActor(_Formulas, ProgrammableActor):
    """`ProgrammableActor` by the formulas as they stand."""


class StraightforwardCritic(_Formulas, ProgrammableCritic):
    """`ProgrammableCritic` by the formulas as they stand."""


class StraightforwardEngine(TorchEngine):
    """`TorchEngine` with the networks above and nothing shared between the two losses."""

    name = "straightforward"

    def _classes(self, network: NetworkConfig) -> tuple[Any, Any]:
        return StraightforwardActor, StraightforwardCritic

    def _step(self, x: Inputs, values: UpdateValues) -> tuple[Tensor, Tensor]:
        target = self._bootstrap(x)  # [B, K]
        q = self._critic(x.objects, x.arm, x.goals, x.action, HAND_INDEX)
        loss = F.mse_loss(q, target)
        action = self._actor(x.objects, x.arm, x.goals, HAND_INDEX)  # [B, K, 6]
        given = action.detach().requires_grad_()
        value = self._critic(x.objects, x.arm, x.goals, given, HAND_INDEX)
        ascent = self._ascent(value, given, values.action_l2)
        self._descend(loss, action, -ascent / q.numel(), values)
        return loss.detach(), q.detach().mean()


def _mlp(layers: nn.ModuleList, x: Tensor) -> Tensor:
    first, last = layers
    y: Tensor = last(torch.tanh(first(x)))
    return y
