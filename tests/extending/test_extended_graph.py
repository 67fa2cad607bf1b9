"""Agents learn over the graph with the examples of this folder."""

from pathlib import Path

import numpy as np
import pytest

from helpers.graph import learned_over_the_graph
from helpers.learners import EXAMPLES, FRAMES, SMALL
from pa_ros.arena import design_named, preset_named, world_of
from pa_ros.core import extensions
from pa_ros.tools.launch_params import Parameters
from pa_ros.world import reward_from

pytestmark = pytest.mark.graph
SHAPED = '{"name": "shaped", "weight": 0.8}'


def extended(*names: str) -> list[str]:
    """The paths of some examples, which are also loaded here."""
    paths = [str(EXAMPLES / f"{name}.py") for name in names]
    extensions.load(paths)
    return paths


def test_only_the_arena_loads_an_arm_and_a_property_group(tmp_path: Path) -> None:
    """It announces the joints and the world, which is all that agent and learner need."""
    files = extended("crane", "shades")
    given: Parameters = {
        "sim_node": {"arm": "crane", "design": "shades", "extensions": files},
        "agent_node": {"learning": True, "agent_id": "agent"},
        "learner_node": {**SMALL, "learner.detectors.sparsity": 0},
    }
    policy, arena = learned_over_the_graph(tmp_path, given, FRAMES // 100)
    config, design = preset_named("fast", "crane"), design_named("shades")
    assert (arena.arm, arena.speed_limits) == ("crane", config.joint_speed_limits)
    world = world_of(config, design)
    assert policy.world_digest == world.digest
    assert policy.tensors["output.weight"].shape[0] == len(arena.joint_names) == 4
    shade = policy.tensors["detectors.weight"][-2:, world.schema.slices["shade"]]
    assert np.abs(shade).min() > 0  # weights start at 0: the number is used


def test_all_nodes_load_a_relation_and_a_reward(tmp_path: Path) -> None:
    files = extended("within", "reward")
    relations = {"relations": ["NEAR", "WITHIN"], "arm": "panda"}
    given: Parameters = {
        "sim_node": {**relations, "reward": SHAPED, "extensions": files},
        "agent_node": {"learning": True, "agent_id": "agent", "extensions": files},
        "learner_node": {"algorithm": "td3", **SMALL, "extensions": files},
    }
    policy, arena = learned_over_the_graph(tmp_path, given, FRAMES // 100)
    design = design_named("2-L").with_relations("NEAR", "WITHIN")
    assert policy.world_digest == world_of(preset_named("fast", "panda"), design).digest
    assert policy.tensors["output.weight"].shape[0] == len(arena.joint_names) == 7
    assert arena.reward == reward_from(SHAPED).to_json()
    weight = policy.tensors["relation.weight"]
    assert weight.shape == (16, 2) and np.abs(weight[:, 0] - weight[:, 1]).min() > 0
