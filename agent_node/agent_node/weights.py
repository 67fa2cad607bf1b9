"""Weights that no learner published here."""

from __future__ import annotations

import numpy as np

from agent_node.config import AgentConfig
from pa_ros.core.experience import PolicySnapshot
from pa_ros.core.published import PublishedPolicy
from pa_ros.learning.protocols import protocol_named
from pa_ros.networks.parameters import initial_actor
from pa_ros.world.world import World


def fixed(snapshot: PolicySnapshot) -> PublishedPolicy:
    """A checkpoint's, or made here."""
    return PublishedPolicy(snapshot, "")


def random_policy(world: World, config: AgentConfig) -> PolicySnapshot:
    """As a learner of the configured network would begin with."""
    network = protocol_named("ours").network_config(world, config.network)
    tensors = initial_actor(network, np.random.default_rng(config.seed))
    return PolicySnapshot(0, network.architecture, world.digest, tensors)
