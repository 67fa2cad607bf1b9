"""The common part of engines in torch: networks, targets and Adam; an algorithm adds its step."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pa_ros.core.errors import ConfigError
from pa_ros.core.update import HAND_INDEX, Batch
from pa_ros.learning.config import LearnerConfig
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import family_of
from pa_ros.networks.parameters import Tensors
from pa_ros.world.programs import ProgramTable

Arrays = dict[str, NDArray[Any]]
ACTOR = "actor"


class Inputs(NamedTuple):
    """A batch on the device: `Batch`, with programs as the networks take them."""

    objects: Tensor
    arm: Tensor
    action: Tensor
    next_objects: Tensor
    next_arm: Tensor
    reward: Tensor
    discount: Tensor
    programs: Any  # `Family.programs`

    @property
    def now(self) -> tuple[Tensor, Tensor, Any]:
        """Inputs of the networks at s."""
        return self.objects, self.arm, self.programs

    @property
    def then(self) -> tuple[Tensor, Tensor, Any]:
        """Inputs of the networks at s'."""
        return self.next_objects, self.next_arm, self.programs


class TorchEngine(ABC):
    """`Engine` with an actor and any number of critics, by name, with their targets and Adam.

    A subclass defines one update in `step`. Targets are copied at the end of each episode unless it
    overrides `end_episode`.
    """

    name = "torch"

    def __init__(
        self,
        network: NetworkConfig,
        config: LearnerConfig,
        table: ProgramTable,
        initial: Mapping[str, Tensors],
    ) -> None:
        """`initial`: weights of the networks by name, the one called "actor" first."""
        torch.set_num_threads(config.engine.threads)
        self._config = config
        self.device = _device_named(config.engine.device)
        self.dtype: torch.dtype = getattr(torch, config.engine.dtype)
        self._network, self._table, self._family = network, table, family_of(network)
        self._rows: list[Tensor] = []  # the programs of the table on the device
        self._known = 0  # how many those are
        # Modules of pa_ros.networks: the actor is called with its inputs, critics have `trunk` and
        # `head`.
        self.networks: dict[str, Any] = {
            name: self._module(name, tensors) for name, tensors in initial.items()
        }
        self.targets: dict[str, Any] = {
            name: copy.deepcopy(module).requires_grad_(False)
            for name, module in self.networks.items()
        }
        self._adams = {name: self._adam(name) for name in self.networks}
        self._latest: tuple[Tensor, ...] | None = None

    @abstractmethod
    def step(self, x: Inputs) -> tuple[Tensor, Tensor]:
        """Make one update by `descend`; the critics' loss and mean Q, detached."""

    def end_episode(self) -> None:
        """Hard copy of all networks to their targets (paper, appendix)."""
        for name, module in self.networks.items():
            self.targets[name].load_state_dict(module.state_dict())

    def update(self, batch: Batch) -> None:
        """One update. On a GPU it is queued: nothing here waits for it."""
        floats = {
            name: torch.from_numpy(getattr(batch, name)).to(self.device).to(self.dtype)
            for name in Inputs._fields
            if name != "programs"
        }
        x = Inputs(**floats, programs=self.programs(batch.program))
        if self._config.optimizer.half_life:
            share = self._config.optimizer.share(max(map(self.updates, self._adams)))
            for adam in self._adams.values():
                for group in adam.param_groups:
                    group["lr"] = group["initial_lr"] * share
        self._latest = self.step(x)

    def programs(self, program: NDArray[np.int32]) -> Any:
        """Rows [B, K] of the table, as the networks take programs."""
        # Tasks add programs while a run learns; only then are the rows copied to the device again.
        if self._known != len(self._table):
            codes = map(torch.from_numpy, self._family.codes(self._table))
            self._rows = [
                code.to(self.device, self.dtype if code.is_floating_point() else torch.int64)
                for code in codes
            ]
            self._known = len(self._table)
        index = torch.from_numpy(program).to(self.device).long()
        return self._family.programs(*(rows[index] for rows in self._rows))

    def act(self, network: Any, seen: tuple[Tensor, Tensor, Any]) -> Tensor:
        """Actions of an actor or its target, [B, K, J]."""
        action: Tensor = network(*seen, HAND_INDEX)
        return action

    def features(self, critic: Any, seen: tuple[Tensor, Tensor, Any]) -> Tensor:
        """Input of a critic's `head` beside the action, [B, K, H]."""
        h: Tensor = critic.trunk(*seen, HAND_INDEX)
        return h

    def descend(self, name: str, loss: Tensor, gradient: Any = None) -> None:
        """A step of Adam for one network by its loss, or, given dL/dy `gradient`, for L of y."""
        adam = self._adams[name]
        adam.zero_grad()
        torch.autograd.backward(loss, gradient)
        adam.step()
        if self._config.detectors.sparsity:
            self._draw_to_zero(adam)

    @torch.no_grad()
    def _draw_to_zero(self, adam: torch.optim.Adam) -> None:
        """Shrink the detectors' weights, never past zero, and less the larger they are.

        This is the proximal step of the minimax concave penalty (Zhang 2010), after Adam's.
        """
        config = self._config.detectors
        # The first group is all parameters but the detectors.
        for group in adam.param_groups[1:]:
            weight = group["params"][0]
            size = weight.abs()
            taken = group["lr"] * config.sparsity * (1.0 - size / config.free_from).clamp_min(0.0)
            weight.copy_(weight.sign() * (size - taken).clamp_min(0.0))

    def actor_tensors(self) -> Tensors:
        """The actor's weights now, float32, owned by the caller."""
        return {
            name: value.detach().to("cpu", torch.float32).numpy().copy()
            for name, value in self.networks[ACTOR].state_dict().items()
        }

    def metrics(self) -> dict[str, float]:
        """Of the latest update: `critic_loss`, `mean_q`, `actor_gradient_norm`; {} before it."""
        if self._latest is None:
            return {}
        gradients = [p.grad for p in self.networks[ACTOR].parameters() if p.grad is not None]
        # An algorithm that updates its actor less often may have no gradients of it yet.
        norms = [g.norm() for g in gradients] or [torch.zeros((), device=self.device)]
        norm = torch.stack(norms).norm()
        values = torch.stack([*self._latest, norm]).tolist()  # the only wait for the device
        return dict(zip(("critic_loss", "mean_q", "actor_gradient_norm"), values, strict=True))

    def tensors(self) -> Arrays:
        """Everything an update depends on; see `Engine.tensors` for the names."""
        tensors: Arrays = {k: value.cpu().numpy().copy() for k, value in self._named().items()}
        steps = {f"adam.{name}.step": self.updates(name) for name in self._adams}
        return tensors | {name: np.array(step, np.int64) for name, step in steps.items()}

    def load_tensors(self, tensors: Arrays) -> None:
        """The inverse of `tensors`, of an engine with the same networks."""
        for name, value in self._named().items():
            value.copy_(torch.from_numpy(tensors[name]))
        for name, adam in self._adams.items():
            for moments in adam.state.values():
                moments["step"].fill_(int(tensors[f"adam.{name}.step"]))

    def gradients(self) -> Tensors:
        """Gradients of the latest update as Adam received them: `actor.*` and `critic.*`."""
        return {
            f"{owner}.{name}": parameter.grad.cpu().numpy()
            for owner, module in self.networks.items()
            for name, parameter in module.named_parameters()
            if parameter.grad is not None
        }

    def updates(self, name: str) -> int:
        """How many steps of Adam a network has had."""
        return int(next(iter(self._adams[name].state.values()))["step"])

    def _named(self) -> dict[str, Tensor]:
        """The live tensors by the names of `Engine.tensors`."""
        named: dict[str, Tensor] = {}
        for prefix, modules in (("", self.networks), ("target_", self.targets)):
            for owner, module in modules.items():
                named |= {f"{prefix}{owner}.{k}": v for k, v in module.state_dict().items()}
        for owner, module in self.networks.items():
            state = self._adams[owner].state
            moments = {name: state[p] for name, p in module.named_parameters()}
            named |= {f"adam.{owner}.m.{k}": m["exp_avg"] for k, m in moments.items()}
            named |= {f"adam.{owner}.v.{k}": m["exp_avg_sq"] for k, m in moments.items()}
        return named

    def _module(self, name: str, tensors: Tensors) -> nn.Module:
        """The actor, or a critic, with these weights."""
        module: nn.Module = self._family.modules()[name != ACTOR](self._network)
        module.load_state_dict({k: torch.from_numpy(v) for k, v in tensors.items()})
        return module.to(self.device, self.dtype)

    def _adam(self, name: str) -> torch.optim.Adam:
        """Adam for all parameters; detectors, if any, are a second group with their own rate."""
        config, module = self._config, self.networks[name]
        rate = config.optimizer.actor_rate if name == ACTOR else config.optimizer.critic_rate
        named = dict(module.named_parameters())
        detectors = [named.pop(k) for k in tuple(named) if k.startswith("detectors.")]
        groups: list[dict[str, Any]] = [{"params": list(named.values()), "lr": rate}]
        if detectors:
            groups.append({"params": detectors, "lr": rate * config.detectors.gain})
        betas = (config.optimizer.beta1, config.optimizer.beta2)
        groups = [{**group, "initial_lr": group["lr"]} for group in groups]
        adam = torch.optim.Adam(groups, betas=betas, eps=config.optimizer.epsilon, fused=True)
        for parameter in module.parameters():  # else made by the first step, too late to load
            adam.state[parameter] = {
                "step": torch.zeros((), dtype=torch.float32, device=self.device),
                "exp_avg": torch.zeros_like(parameter),
                "exp_avg_sq": torch.zeros_like(parameter),
            }
        return adam


def _device_named(name: str) -> torch.device:
    try:
        probe = torch.zeros(1, device=name)
        probe.cpu()  # fails for `meta`, which holds no numbers
        return probe.device
    except (RuntimeError, AssertionError) as error:
        reason = str(error).partition("\n")[0]
        raise ConfigError(
            f"learner device: expected one that torch has here, got {name!r}: {reason}"
        ) from error
