"""Agents as they are configured, and weights that no learner published here."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from agent_node.config import AgentConfig
from pa_ros.acting.agent import Agent
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.core.experience import AgentKey, PolicySnapshot
from pa_ros.core.published import PublishedPolicy
from pa_ros.language import logic_named
from pa_ros.learning.checkpoints import load_policy
from pa_ros.learning.protocols import protocol_named
from pa_ros.networks.parameters import initial_actor
from pa_ros.world.world import World


def agent_of(config: AgentConfig, key: AgentKey) -> Agent:
    """An agent with its weights, if a checkpoint has them. Raises CheckpointError."""
    if config.learning:
        return LearningAgent(key, config.seed)
    agent = Agent(key, logic_named(config.logic))
    if config.weights == "checkpoint":
        agent.offer(fixed(load_policy(Path(config.checkpoint))))
    return agent  # random weights need the arena's vocabulary first


def fixed(snapshot: PolicySnapshot) -> PublishedPolicy:
    """A checkpoint's, or made here."""
    return PublishedPolicy(snapshot, "")


def random_policy(world: World, config: AgentConfig) -> PolicySnapshot:
    """As a learner of the configured network would begin with."""
    network = protocol_named("ours").network_config(world, config.network)
    tensors = initial_actor(network, np.random.default_rng(config.seed))
    return PolicySnapshot(0, network.architecture, world.digest, tensors)
