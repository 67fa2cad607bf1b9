"""The seam between the learner and whatever computes one DPG update."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32
from pa_ros.learning.algorithms.dpg.config import LearnerConfig
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import Tensors, initial_actor, initial_critic
from pa_ros.world.programs import ProgramTable

log = logging.getLogger(__name__)

HAND_INDEX = 0  # of every batch: the replay stores the hand first, whatever its index outside


@dataclass(frozen=True, slots=True)
class Batch:
    """B transitions × K programs. Arrays are C-contiguous; the hand is object 0."""

    objects: Float32  # [B, N, 16]
    arm: Float32  # [B, 18]
    action: Float32  # [B, 6]
    next_objects: Float32  # [B, N, 16]
    next_arm: Float32  # [B, 18]
    program: NDArray[np.int32]  # [B, K], rows of the ProgramTable
    reward: Float32  # [B, K]
    discount: Float32  # [B]; γ, or 0 after a true termination


class Engine(Protocol):
    """Actor, critic, their targets and optimizers, somewhere.

    Built by `Engine(network, config, table, actor, critic)` with the initial tensors of both
    networks; the targets start as copies. The table may grow between updates.
    """

    name: str

    def update(self, batch: Batch) -> None:
        """One DPG update of critic and actor, both gradients at the parameters before it."""

    def copy_targets(self) -> None:
        """Hard copy of both networks to their targets (paper, appendix)."""

    def actor_tensors(self) -> Tensors:
        """The actor's weights now, float32, owned by the caller."""

    def metrics(self) -> dict[str, float]:
        """Of the latest update: `critic_loss`, `mean_q`, `actor_gradient_norm`; {} before it."""

    def tensors(self) -> dict[str, NDArray[np.generic]]:
        """Everything an update depends on, owned by the caller.

        Names: `actor.*`, `critic.*`, `target_actor.*`, `target_critic.*`, then for each of actor
        and critic `adam.actor.m.*`, `adam.actor.v.*` (first and second moments, shaped as the
        parameters) and `adam.actor.step` (int64 []).
        """

    def load_tensors(self, tensors: dict[str, NDArray[np.generic]]) -> None:
        """The inverse of `tensors`; TensorError when names or shapes differ."""


def make_engine(
    network: NetworkConfig,
    config: LearnerConfig,
    table: ProgramTable,
    rng: np.random.Generator,
) -> Engine:
    """A engine with random initial weights; "auto" takes the fused one where it applies.

    Raises ConfigError if `config.engine` is "fused" and it does not apply, with the reason.
    """
    actor, critic = initial_actor(network, rng), initial_critic(network, rng)
    reason = "chosen" if config.engine == "torch" else _why_not_fused(network, config)
    if config.engine == "fused" and reason:
        raise ConfigError(f"learner engine: expected one that applies, got 'fused': {reason}")
    made: Engine
    if reason:
        from pa_ros.learning.algorithms.dpg.torch_engine import TorchEngine

        made = TorchEngine(network, config, table, actor, critic)
    else:
        from pa_ros.native.engine import FusedEngine

        made = FusedEngine(network, config, table, actor, critic)
    log.info("learner engine: %s%s", made.name, f" ({reason})" if reason else "")
    return made


def _why_not_fused(network: NetworkConfig, config: LearnerConfig) -> str:
    """Empty where the fused update applies, else the reason that the log gives."""
    try:
        from pa_ros.native import engine as fused
    except (ImportError, OSError) as error:
        return f"no fused update: {error}"
    reason: str = fused.why_not(network, config)
    return reason
