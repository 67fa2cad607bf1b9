"""TD3 as an algorithm; torch computes its updates."""

from __future__ import annotations

import logging

import numpy as np

from pa_ros.core.errors import ConfigError
from pa_ros.core.update import Engine
from pa_ros.learning.algorithms.algorithm import Algorithm
from pa_ros.learning.algorithms.dpg.builder import initial_networks
from pa_ros.learning.algorithms.td3.config import CRITICS, TD3Config
from pa_ros.networks.config import NetworkConfig
from pa_ros.world.programs import ProgramTable

log = logging.getLogger(__name__)


def make_engine(
    network: NetworkConfig,
    config: TD3Config,
    table: ProgramTable,
    rng: np.random.Generator,
) -> Engine:
    """An engine with random initial weights; ConfigError if the fused one is asked for."""
    if config.engine.name == "fused":
        raise ConfigError(
            "learner engine: expected one that applies, got 'fused': td3 is computed by torch alone"
        )
    from pa_ros.learning.algorithms.td3.learner import TorchTD3

    initial = initial_networks(network, config, rng, CRITICS)
    engine = TorchTD3(network, config, table, initial)
    log.info("learner engine: %s", engine.name)
    return engine


# Targets that follow within 100 updates, as DPG's hard copies do.
_OURS = {"learner.targets.tau": 0.02}

TD3 = Algorithm(TD3Config, make_engine, {"ours": _OURS})
