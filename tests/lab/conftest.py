"""An untrained 3-D agent whose detectors are right: enough to test how agents are scored."""

import numpy as np
import pytest

from pa_ros.agents import TrainedAgent
from pa_ros.arena import design_named, preset_named, world_of
from pa_ros.core.experience import PolicySnapshot
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import initial_actor

CRISP = 12.0  # logit of what is true; of what is not, 0


@pytest.fixture
def novice() -> TrainedAgent:
    """Random weights, save detectors that read the one-hots of what the vocabulary names."""
    design, arena = design_named("3-D"), preset_named("fast")
    config = NetworkConfig(
        world=world_of(arena, design), hidden=8, attention=4, actor_output_scale=0.5
    )
    tensors = initial_actor(config, np.random.default_rng(0))
    tensors["detectors.weight"][:] = 0.0
    tensors["detectors.bias"][:] = 0.0
    tensors["detectors.weight"][:, :16] = CRISP * config.world.truth(np.eye(16, dtype=np.float32)).T
    snapshot = PolicySnapshot(3, config.architecture, config.world.digest, tensors)
    return TrainedAgent(snapshot, design, arena.changed(episode_steps=12))
