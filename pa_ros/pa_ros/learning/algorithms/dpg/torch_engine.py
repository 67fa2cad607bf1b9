"""One DPG update in torch: the readable reference, and the engine for GPUs and MLPs."""

from __future__ import annotations

import copy
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional as F

from pa_ros.core.errors import ConfigError
from pa_ros.core.update import HAND_INDEX, Batch, UpdateValues
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import (
    COLUMN_FEATURES,
    GEOMETRY,
    Shapes,
    Tensors,
    actor_shapes,
    check_shapes,
    check_tensors,
    critic_shapes,
)
from pa_ros.world.programs import ProgramTable

Arrays = dict[str, NDArray[Any]]

_STEPS: Shapes = {"adam.actor.step": (), "adam.critic.step": ()}


class Inputs(NamedTuple):
    """A batch on the device, as `Batch` but for what the networks are told of each program."""

    objects: Tensor
    arm: Tensor
    action: Tensor
    next_objects: Tensor
    next_arm: Tensor
    reward: Tensor
    discount: Tensor
    goals: Any  # `Family.goals`


class TorchEngine:
    """Paper, appendix "Training parameters"; Lillicrap et al. 2015 with hard target copies."""

    name = "torch"

    def __init__(
        self,
        network: NetworkConfig,
        config: DPGConfig,
        table: ProgramTable,
        actor: Tensors,
        critic: Tensors,
    ) -> None:
        check_tensors(actor, actor_shapes(network), "actor")
        check_tensors(critic, critic_shapes(network), "critic")
        torch.set_num_threads(config.engine.threads)
        self._config = config
        self._device = _device_named(config.engine.device)
        self._dtype = getattr(torch, config.engine.dtype)
        self._goals = _Goals(network, table, self._device, self._dtype)
        self._actor: Any  # a module of pa_ros.networks; its critic has `trunk` and `head`
        self._critic: Any
        self._actor, self._critic = self._networks(network, actor, critic)
        self._target_actor = copy.deepcopy(self._actor).requires_grad_(False)
        self._target_critic = copy.deepcopy(self._critic).requires_grad_(False)
        self._actor_adam = self._adam(self._actor)
        self._critic_adam = self._adam(self._critic)
        geometry = torch.zeros(COLUMN_FEATURES)
        geometry[GEOMETRY] = 1.0
        self._geometry = geometry.to(self._device, self._dtype)
        self._latest: tuple[Tensor, ...] | None = None

    def update(self, batch: Batch, values: UpdateValues) -> None:
        """One DPG update of critic and actor, both gradients at the parameters before it.

        On a GPU it is queued: nothing here waits for it.
        """
        self._goals.refresh()
        tensors = {
            field.name: torch.from_numpy(getattr(batch, field.name)).to(self._device)
            for field in fields(batch)
        }
        floats = {k: tensors[k].to(self._dtype) for k in Inputs._fields if k != "goals"}
        x = Inputs(**floats, goals=self._goals.of(tensors["program"]))
        self._latest = self._step(x, values)

    def _step(self, x: Inputs, values: UpdateValues) -> tuple[Tensor, Tensor]:
        """Update both networks; the critic's loss and mean Q."""
        target = self._bootstrap(x)  # [B, K]
        h = self._critic.trunk(x.objects, x.arm, x.goals, HAND_INDEX)  # [B, K, H]
        q = self._critic.head(h, x.action)  # [B, K]
        loss = F.mse_loss(q, target)
        action = self._actor(x.objects, x.arm, x.goals, HAND_INDEX)  # [B, K, 6]
        given = action.detach().requires_grad_()
        ascent = self._ascent(self._critic.head(h.detach(), given), given, values.action_l2)
        self._descend(loss, action, -ascent / q.numel(), values)
        return loss.detach(), q.detach().mean()

    def _bootstrap(self, x: Inputs) -> Tensor:
        """r + discount · Q'(s', π'(s')), [B, K]."""
        with torch.no_grad():
            seen = (x.next_objects, x.next_arm, x.goals)
            action = self._target_actor(*seen, HAND_INDEX)
            value = self._target_critic(*seen, action, HAND_INDEX)
            bootstrapped: Tensor = x.reward + x.discount[:, None] * value
            return bootstrapped

    def _ascent(self, q: Tensor, action: Tensor, action_l2: float) -> Tensor:
        """∂/∂a of the actor's objective: ∂Q/∂a clipped, less λa, [B, K, 6]."""
        (gradient,) = torch.autograd.grad(q.sum(), action)
        clip = self._config.actor.gradient_clip
        ascent: Tensor = gradient.clamp(-clip, clip) - action_l2 * action.detach()
        return ascent

    def _descend(
        self, loss: Tensor, action: Tensor, action_gradient: Tensor, values: UpdateValues
    ) -> None:
        """A step of Adam for the critic's loss, and for the actor by the chain rule."""
        self._critic_adam.zero_grad()
        torch.autograd.backward(loss)
        self._actor_adam.zero_grad()
        torch.autograd.backward(action, action_gradient)
        self._apply(self._critic_adam, values.critic_rate, values)
        self._apply(self._actor_adam, values.actor_rate, values)

    def _apply(self, adam: torch.optim.Adam, rate: float, values: UpdateValues) -> None:
        """Adam's step; the detectors' weights decay before it and forget geometry after it.

        Decay is apart from the gradient (Loshchilov & Hutter 2019).
        """
        others, *detectors = adam.param_groups
        others["lr"] = rate
        for group in detectors:
            group["lr"] = rate * self._config.detectors.gain
            with torch.no_grad():
                group["params"][0].mul_(1.0 - group["lr"] * values.detector_decay)
        adam.step()
        for group in detectors:
            with torch.no_grad():
                group["params"][0].mul_(1.0 - values.geometry_decay * self._geometry)

    def copy_targets(self) -> None:
        """Hard copy of both networks to their targets (paper, appendix)."""
        self._target_actor.load_state_dict(self._actor.state_dict())
        self._target_critic.load_state_dict(self._critic.state_dict())

    def actor_tensors(self) -> Tensors:
        """The actor's weights now, float32, owned by the caller."""
        return {
            name: value.detach().to("cpu", torch.float32).numpy().copy()
            for name, value in self._actor.state_dict().items()
        }

    def metrics(self) -> dict[str, float]:
        """Of the latest update: `critic_loss`, `mean_q`, `actor_gradient_norm`; {} before it."""
        if self._latest is None:
            return {}
        gradients = [p.grad for p in self._actor.parameters() if p.grad is not None]
        norm = torch.stack([g.norm() for g in gradients]).norm()
        values = torch.stack([*self._latest, norm]).tolist()  # the only wait for the device
        return dict(zip(("critic_loss", "mean_q", "actor_gradient_norm"), values, strict=True))

    def tensors(self) -> Arrays:
        """Everything an update depends on; see `Engine.tensors` for the names."""
        tensors: Arrays = {k: value.cpu().numpy().copy() for k, value in self._named().items()}
        for name, adam in self._optimizers().items():
            steps = [int(moments["step"]) for moments in adam.state.values()]
            tensors[name] = np.array(steps[0], np.int64)
        return tensors

    def load_tensors(self, tensors: Arrays) -> None:
        """The inverse of `tensors`; TensorError when names or shapes differ."""
        named = self._named()
        check_shapes(tensors, {k: tuple(v.shape) for k, v in named.items()} | _STEPS, "engine")
        for name, value in named.items():
            value.copy_(torch.from_numpy(tensors[name]))
        for name, adam in self._optimizers().items():
            for moments in adam.state.values():
                moments["step"].fill_(int(tensors[name]))

    def gradients(self) -> Tensors:
        """Of the latest update, `actor.*` and `critic.*`: what Adam was given."""
        owners = {"actor": self._actor, "critic": self._critic}
        return {
            f"{owner}.{name}": parameter.grad.cpu().numpy()
            for owner, module in owners.items()
            for name, parameter in module.named_parameters()
        }

    def _named(self) -> dict[str, Tensor]:
        """The live tensors by the names of `Engine.tensors`."""
        named: dict[str, Tensor] = {}
        for prefix in ("actor", "critic", "target_actor", "target_critic"):
            module: nn.Module = getattr(self, f"_{prefix}")
            named |= {f"{prefix}.{k}": v for k, v in module.state_dict().items()}
        for prefix, module, adam in (
            ("actor", self._actor, self._actor_adam),
            ("critic", self._critic, self._critic_adam),
        ):
            moments = {name: adam.state[p] for name, p in module.named_parameters()}
            named |= {f"adam.{prefix}.m.{k}": m["exp_avg"] for k, m in moments.items()}
            named |= {f"adam.{prefix}.v.{k}": m["exp_avg_sq"] for k, m in moments.items()}
        return named

    def _optimizers(self) -> dict[str, torch.optim.Adam]:
        return {"adam.actor.step": self._actor_adam, "adam.critic.step": self._critic_adam}

    def _networks(
        self, network: NetworkConfig, actor: Tensors, critic: Tensors
    ) -> tuple[nn.Module, nn.Module]:
        made = [kind(network).to(self._device, self._dtype) for kind in network.family.modules()]
        for module, tensors in zip(made, (actor, critic), strict=True):
            module.load_state_dict({k: torch.from_numpy(v) for k, v in tensors.items()})
        return made[0], made[1]

    def _adam(self, module: nn.Module) -> torch.optim.Adam:
        """Adam of all parameters, then, as a group of their own, of the detectors if any."""
        config = self._config
        named = dict(module.named_parameters())
        detectors = [named.pop(k) for k in tuple(named) if k.startswith("detectors.")]
        groups: list[dict[str, Any]] = [{"params": list(named.values())}]
        if detectors:
            groups.append({"params": detectors})
        betas = (config.optimizer.beta1, config.optimizer.beta2)
        adam = torch.optim.Adam(groups, betas=betas, eps=config.optimizer.epsilon, fused=True)
        for parameter in module.parameters():  # else made by the first step, too late to load
            adam.state[parameter] = {
                "step": torch.zeros((), dtype=torch.float32, device=self._device),
                "exp_avg": torch.zeros_like(parameter),
                "exp_avg_sq": torch.zeros_like(parameter),
            }
        return adam


def _device_named(name: str) -> torch.device:
    try:
        return torch.zeros(0, device=name).device
    except (RuntimeError, AssertionError) as error:
        reason = str(error).partition("\n")[0]
        raise ConfigError(
            f"learner device: expected one that torch has here, got {name!r}: {reason}"
        ) from error


class _Goals:
    """What the networks are told of each program of a table."""

    def __init__(
        self, network: NetworkConfig, table: ProgramTable, device: torch.device, dtype: torch.dtype
    ) -> None:
        self._family = network.family
        self._table = table
        self._device, self._dtype = device, dtype
        self._size = 0  # rows of the table that are on the device
        self._rows: list[Tensor] = []

    def refresh(self) -> None:
        """Bring rows that joined the table to the device."""
        if self._size != len(self._table):
            codes = map(torch.from_numpy, self._family.codes(self._table))
            self._rows = [
                code.to(self._device, self._dtype if code.is_floating_point() else torch.int64)
                for code in codes
            ]
            self._size = len(self._table)

    def of(self, program: Tensor) -> Any:
        """For rows [B, K] of the table."""
        index = program.long()
        return self._family.goals(*(rows[index] for rows in self._rows))
