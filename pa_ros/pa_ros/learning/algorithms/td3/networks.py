"""TD3's networks: an actor and two critics that differ in their initial weights alone."""

from __future__ import annotations

import numpy as np

from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import Tensors, initial_actor, initial_critic

CRITICS = ("critic_1", "critic_2")


def initial_networks(network: NetworkConfig, rng: np.random.Generator) -> dict[str, Tensors]:
    """Random initial weights by the network's name; the same `rng` state, the same weights."""
    actor = {"actor": initial_actor(network, rng)}
    return actor | {name: initial_critic(network, rng) for name in CRITICS}
