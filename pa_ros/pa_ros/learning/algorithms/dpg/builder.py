"""DPG as an algorithm: which engine computes its updates, and why."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pa_ros.core.errors import ConfigError
from pa_ros.core.update import Engine
from pa_ros.learning.algorithms.algorithm import Algorithm
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.config import LearnerConfig
from pa_ros.native.library import why_not_network
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import Tensors, initial_actor, initial_critic
from pa_ros.world.programs import ProgramTable

if TYPE_CHECKING:  # it needs the library, which may be absent
    from pa_ros.native.engine import FusedEngine

log = logging.getLogger(__name__)


def make_engine(
    network: NetworkConfig,
    config: DPGConfig,
    table: ProgramTable,
    rng: np.random.Generator,
) -> Engine:
    """An engine with random initial weights; "auto" takes the fused one where it applies.

    Raises ConfigError if `config.engine.name` is "fused" and it does not apply, with the reason.
    """
    actor, critic = initial_networks(network, config, rng).values()
    reason = "chosen" if config.engine.name == "torch" else why_not_fused(network, config)
    if config.engine.name == "fused" and reason:
        raise ConfigError(f"learner engine: expected one that applies, got 'fused': {reason}")
    made: Engine
    if reason:
        from pa_ros.learning.algorithms.dpg.learner import TorchDPG

        made = TorchDPG(network, config, table, actor, critic)
    else:
        made = fused_engine(network, config, table, actor, critic)
    log.info("learner engine: %s%s", made.name, f" ({reason})" if reason else "")
    return made


def fused_engine(
    network: NetworkConfig,
    config: DPGConfig,
    table: ProgramTable,
    actor: Tensors,
    critic: Tensors,
) -> FusedEngine:
    """The fused engine; it takes numbers, and knows no settings."""
    from pa_ros.native.engine import FusedEngine

    optimizer, detectors = config.optimizer, config.detectors
    return FusedEngine(
        *(network, table, actor, critic, optimizer.share, config.engine.threads),
        actor_rate=optimizer.actor_rate,
        critic_rate=optimizer.critic_rate,
        beta1=optimizer.beta1,
        beta2=optimizer.beta2,
        epsilon=optimizer.epsilon,
        clip=config.gradient_clip,
        action_penalty=config.action_penalty,
        detector_gain=detectors.gain,
        sparsity=detectors.sparsity,
        free_from=detectors.free_from,
    )


def initial_networks(
    network: NetworkConfig,
    config: LearnerConfig,
    rng: np.random.Generator,
    critics: Sequence[str] = ("critic",),
) -> dict[str, Tensors]:
    """Random initial weights of actor and critics; the same `rng` state, the same weights."""
    start = network.critic_start(config.updates.discount)
    actor = {"actor": initial_actor(network, rng)}
    return actor | {name: initial_critic(network, rng, start) for name in critics}


def why_not_fused(network: NetworkConfig, config: DPGConfig) -> str:
    """Why the fused engine cannot make a learner's updates; empty: it can."""
    device, dtype = config.engine.device, config.engine.dtype
    if device != "cpu" or dtype != "float32":
        return f"it is for float32 on the CPU, not {dtype} on {device}"
    return why_not_network(network)


DPG = Algorithm(
    DPGConfig,
    make_engine,
    {
        "push": {"learner.action_penalty": 0.1},
        "stack": {"learner.action_penalty": 0.03},
        "entries": {"learner.action_penalty": 0.01},
    },
)
