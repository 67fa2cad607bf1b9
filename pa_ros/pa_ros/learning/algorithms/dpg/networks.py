"""DPG's networks: an actor and a critic."""

from __future__ import annotations

import numpy as np

from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import Tensors, initial_actor, initial_critic


def initial_networks(network: NetworkConfig, rng: np.random.Generator) -> dict[str, Tensors]:
    """Random initial weights by the network's name; the same `rng` state, the same weights."""
    return {"actor": initial_actor(network, rng), "critic": initial_critic(network, rng)}
