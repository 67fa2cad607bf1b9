"""One DPG update in torch: the readable reference, and the engine for GPUs and MLPs."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.algorithms.torch_engine import Inputs, TorchEngine
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import Tensors
from pa_ros.world.programs import ProgramTable


class TorchDPG(TorchEngine):
    """Paper, appendix "Training parameters"; Lillicrap et al. 2015 with hard target copies."""

    def __init__(
        self,
        network: NetworkConfig,
        config: DPGConfig,
        table: ProgramTable,
        actor: Tensors,
        critic: Tensors,
    ) -> None:
        super().__init__(network, config, table, {"actor": actor, "critic": critic})
        self._clip, self._penalty = config.gradient_clip, config.action_penalty

    def step(self, x: Inputs) -> tuple[Tensor, Tensor]:
        """Update both networks, both gradients at the parameters before it."""
        actor, critic = self.networks["actor"], self.networks["critic"]
        target = self._bootstrap(x)  # [B, K]
        h = self.features(critic, x.now)  # [B, K, H]
        q = critic.head(h, x.action)  # [B, K]
        loss = F.mse_loss(q, target)
        action = self.act(actor, x.now)  # [B, K, J]
        # The action as a leaf: ∂Q/∂a is all that the actor needs of the critic, and taking it so
        # adds nothing to the critic's own gradients.
        given = action.detach().requires_grad_()
        ascent = self._ascent(critic.head(h.detach(), given), given)
        self.descend("critic", loss)
        self.descend("actor", action, -ascent / q.numel())
        return loss.detach(), q.detach().mean()

    def _bootstrap(self, x: Inputs) -> Tensor:
        """r + discount · Q'(s', π'(s')), [B, K]."""
        critic = self.targets["critic"]
        with torch.no_grad():
            action = self.act(self.targets["actor"], x.then)
            value = critic.head(self.features(critic, x.then), action)
            bootstrapped: Tensor = x.reward + x.discount[:, None] * value
            return bootstrapped

    def _ascent(self, q: Tensor, action: Tensor) -> Tensor:
        """∂/∂a of the actor's objective: ∂Q/∂a clipped, less the penalty's, [B, K, J]."""
        (gradient,) = torch.autograd.grad(q.sum(), action)
        clipped = gradient.clamp(-self._clip, self._clip)
        return clipped - self._penalty * action.detach() if self._penalty else clipped
