"""One DPG update on the CPU in C++ with manual gradients, and the same code as an actor.

The formulas are those of docs/DESIGN.md, "Networks" and "Learning"; see native/trunk.h for how
they are rearranged. Float32; deterministic for given inputs, threads and instruction set.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32
from pa_ros.core.update import HAND_INDEX, Batch
from pa_ros.language import PRODUCT, Logic, Program
from pa_ros.native import _fused
from pa_ros.native.families import FUSED
from pa_ros.native.tensors import FlatTensors
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.detectors import sharpened
from pa_ros.networks.families import family_of
from pa_ros.networks.parameters import Tensors
from pa_ros.world.programs import ProgramTable

Arrays = dict[str, NDArray[Any]]
log = logging.getLogger(__name__)


class _Trained:
    """One network's flat buffers, which the library owns, and how many updates they had."""

    def __init__(
        self, name: str, network: _fused.Network, buffers: _fused.Trained, tensors: Tensors
    ) -> None:
        self._buffers, self.step = buffers, 0
        self.parameters = FlatTensors(network, buffers.parameters)
        self.gradient = FlatTensors(network, buffers.gradient)
        self.named = {
            f"{name}.": self.parameters,
            f"target_{name}.": FlatTensors(network, buffers.target),
            f"adam.{name}.m.": FlatTensors(network, buffers.first_moment),
            f"adam.{name}.v.": FlatTensors(network, buffers.second_moment),
        }  # by the prefixes of `Engine.tensors`
        self.parameters.write(tensors)
        self.copy_target()

    def copy_target(self) -> None:
        self._buffers.target[:] = self._buffers.parameters


class FusedEngine:
    """`Engine` by the native library; see `pa_ros.core.update` for the contract.

    Only for networks that `library.why_not_network` allows. FusedError for a batch that does not
    fit.
    """

    name = "fused"

    def __init__(
        self,
        network: NetworkConfig,
        table: ProgramTable,
        actor: Tensors,
        critic: Tensors,
        rate_share: Callable[[int], float],
        threads: int,
        **numbers: float,
    ) -> None:
        """`rate_share`: of both learning rates, by updates so far; `numbers`: the library's own."""
        self._family = FUSED[type(family_of(network))]
        actor_network, critic_network = (self._family.describe(network, x) for x in (False, True))
        self._engine = _fused.Engine(
            actor_network,
            critic_network,
            detector_arm=network.detectors_see_arm,
            detector_bias=network.detectors_have_biases,
            threads=threads,
            **numbers,
        )
        self._rate_share = rate_share
        self._betas = numbers["beta1"], numbers["beta2"]
        self._trained = {
            "actor": _Trained("actor", actor_network, self._engine.actor, actor),
            "critic": _Trained("critic", critic_network, self._engine.critic, critic),
        }
        self._network, self._table = network, table
        self._known = 0  # programs of the table that the library has
        self._metrics: _fused.Metrics | None = None
        self._warned = False

    def update(self, batch: Batch) -> None:
        """One DPG update of critic and actor, both gradients at the parameters before it."""
        # Programs join the table as trajectories arrive; the library gets the table only when it
        # grew.
        if self._known != len(self._table):
            self._family.set_programs(self._engine, self._table)
            self._known = len(self._table)
        # Adam corrects its moments for having started at zero; the powers are taken here in
        # float64.
        step = self._trained["actor"].step + 1
        correction1, correction2 = (1.0 - beta**step for beta in self._betas)
        self._metrics = self._engine.update(
            objects=batch.objects,
            arm=batch.arm,
            action=batch.action,
            next_objects=batch.next_objects,
            next_arm=batch.next_arm,
            program=batch.program,
            reward=batch.reward,
            discount=batch.discount,
            hand_index=HAND_INDEX,
            correction1=correction1,
            correction2=correction2,
            rate_share=self._rate_share(step - 1),
        )
        for trained in self._trained.values():
            trained.step += 1
        self._warn_if_clamped(self._metrics.largest_part)

    def end_episode(self) -> None:
        """Hard copy of both networks to their targets (paper, appendix)."""
        for trained in self._trained.values():
            trained.copy_target()

    def actor_tensors(self) -> Tensors:
        """The actor's weights now, float32, owned by the caller."""
        return self._trained["actor"].parameters.read()

    def metrics(self) -> dict[str, float]:
        """Of the latest update: `critic_loss`, `mean_q`, `actor_gradient_norm`; {} before it."""
        if self._metrics is None:
            return {}
        return {
            "critic_loss": self._metrics.critic_loss,
            "mean_q": self._metrics.mean_q,
            "actor_gradient_norm": self._metrics.actor_gradient_norm,
        }

    def gradients(self) -> Tensors:
        """Gradients of the latest update as Adam received them: `actor.*` and `critic.*`."""
        return {
            f"{name}.{key}": value
            for name, trained in self._trained.items()
            for key, value in trained.gradient.read().items()
        }

    def tensors(self) -> Arrays:
        """Everything an update depends on; see `Engine.tensors` for the names."""
        tensors: Arrays = {}
        for name, trained in self._trained.items():
            for prefix, flat in trained.named.items():
                tensors |= {prefix + k: v for k, v in flat.read().items()}
            tensors[f"adam.{name}.step"] = np.array(trained.step, np.int64)
        return tensors

    def load_tensors(self, tensors: Arrays) -> None:
        """The inverse of `tensors`, of an engine with the same networks."""
        for name, trained in self._trained.items():
            for prefix, flat in trained.named.items():
                own = {
                    k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)
                }
                flat.write(cast(Tensors, own))
            trained.step = int(tensors[f"adam.{name}.step"])

    def _warn_if_clamped(self, largest: float) -> None:
        limit = _fused.LARGEST_PART
        if largest > limit and not self._warned:
            self._warned = True
            log.warning(
                "fused update: a first layer reaches %.1f, and sums of two such are exact only to "
                "%.1f; use the torch engine if weights are meant to be this large",
                *(largest, limit),
            )


class FusedActor:
    """`pa_ros.networks.inference.Inference` by the native library; one thread at a time."""

    def __init__(self, config: NetworkConfig, tensors: Tensors, logic: Logic = PRODUCT) -> None:
        self._config, self._logic = config, logic
        self._family = FUSED[type(family_of(config))]
        described = self._family.describe(config, critic=False, logic=logic)
        self._actor = _fused.Actor(described)
        self._flat = FlatTensors(described, self._actor.parameters)
        self._actions = config.world.actions
        self._newest: Program | None = None  # that the library has
        self.load(tensors)

    def load(self, tensors: Tensors) -> None:
        """Act with these weights from now on."""
        self._flat.write(sharpened(tensors, self._logic))

    def act(self, objects: Float32, arm: Float32, program: Program, hand_index: int) -> Float32:
        """See `Inference.act`."""
        self._take(program)
        action = np.empty(self._actions, np.float32)
        self._actor.act(objects, arm, hand_index, action)
        return action

    def degrees(self, objects: Float32, arm: Float32, program: Program, hand: int) -> Float32:
        """See `Inference.degrees`."""
        self._take(program)
        degrees = np.empty((4, len(objects)), np.float32)
        self._actor.degrees(objects, arm, hand, degrees)
        return degrees

    def _take(self, program: Program) -> None:
        # Compiling takes longer than acting, and an agent acts on one program for many steps.
        if self._newest is not program:
            self._newest = None  # if compiling fails, the library's is not the newest
            self._family.set_program(self._actor, program, self._config)
            self._newest = program
