"""One TD3 update in torch (Fujimoto et al. 2018, algorithm 1)."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from pa_ros.learning.algorithms.td3.config import CRITICS, TD3Config
from pa_ros.learning.algorithms.torch_engine import Inputs, TorchEngine

SMOOTHING_STREAM = 0x7D3  # of default_rng([stream, update])


class TorchTD3(TorchEngine):
    """Twin critics, smoothed targets, and an actor that is updated less often.

    As DPG's here, all gradients of an update are taken at the parameters before it.
    """

    _config: TD3Config

    def step(self, x: Inputs) -> tuple[Tensor, Tensor]:
        """Update the critics, and every `delay` updates actor and targets."""
        update = self.updates(CRITICS[0])
        target = self._bootstrap(x, update)  # [B, K]
        features = [self.features(self.networks[name], x.now) for name in CRITICS]  # [B, K, H]
        values_of = [
            self.networks[name].head(h, x.action) for name, h in zip(CRITICS, features, strict=True)
        ]
        losses = [F.mse_loss(q, target) for q in values_of]
        follows = (update + 1) % self._config.delay == 0
        if follows:
            self._improve(x, features[0].detach())
        for name, loss in zip(CRITICS, losses, strict=True):
            self.descend(name, loss)
        if follows:
            self._follow()
        return torch.stack(losses).detach().mean(), values_of[0].detach().mean()

    def end_episode(self) -> None:
        """Nothing: the targets follow at every `delay`-th update."""

    def _bootstrap(self, x: Inputs, update: int) -> Tensor:
        """r + discount · min Q'(s', π'(s') + ε), ε clipped, [B, K]."""
        with torch.no_grad():
            action = self.act(self.targets["actor"], x.then)
            action = (action + self._noise(action.shape, update)).clamp(-1.0, 1.0)
            critics = [self.targets[name] for name in CRITICS]
            least = torch.stack([c.head(self.features(c, x.then), action) for c in critics]).amin(0)
            bootstrapped: Tensor = x.reward + x.discount[:, None] * least
            return bootstrapped

    def _noise(self, shape: torch.Size, update: int) -> Tensor:
        """ε, [B, K, J], a function of the number of updates alone, so resuming needs no state."""
        smoothing = self._config.smoothing
        drawn = np.random.default_rng([SMOOTHING_STREAM, update]).normal(0, smoothing.sigma, shape)
        return torch.from_numpy(drawn.clip(-smoothing.clip, smoothing.clip)).to(
            self.device, self.dtype
        )

    def _improve(self, x: Inputs, h: Tensor) -> None:
        """A step of the actor up the first critic."""
        action = self.act(self.networks["actor"], x.now)  # [B, K, J]
        given = action.detach().requires_grad_()
        q = self.networks[CRITICS[0]].head(h, given)
        (gradient,) = torch.autograd.grad(q.sum(), given)
        self.descend("actor", action, -gradient / q.numel())

    @torch.no_grad()
    def _follow(self) -> None:
        """Each target moves a share τ of the way."""
        for name, module in self.networks.items():
            pairs = zip(self.targets[name].parameters(), module.parameters(), strict=True)
            for target, parameter in pairs:
                target.lerp_(parameter, self._config.targets.tau)
