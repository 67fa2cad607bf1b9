"""Three episodes in lockstep over the graph of real processes end where the loop ends."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.graph import learned_over_the_graph
from helpers.learners import small
from pa_ros.arena import ReachTask, design_named, preset_named, training_programs, world_of
from pa_ros.core.experience import PolicySnapshot
from pa_ros.learning.checkpoints import read_metadata
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.loop import train
from pa_ros.learning.recipes import LearningSettings, recipe_for
from pa_ros.tools.launch_params import Parameters

pytestmark = pytest.mark.graph
SEED, EPISODES = 11, 3
OPTIONS = small(20, 16, 32)


def parameters(**changes: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Of three nodes that learn as `in_process` does."""
    common: dict[str, dict[str, Any]] = {
        "sim_node": {"seed": SEED},
        "agent_node": {"learning": True, "seed": SEED, "agent_id": "agent"},
        "learner_node": {"seed": SEED, **OPTIONS},
    }
    return {node: values | changes.get(node, {}) for node, values in common.items()}


def over_the_graph(
    folder: Path, version: int, given: Parameters, compose: bool = False
) -> PolicySnapshot:
    """As three processes learned it, or two with the arena and the agent composed."""
    return learned_over_the_graph(folder, given, version, compose)[0]


def in_process(folder: Path, version: int, name: str) -> dict[str, np.ndarray]:
    design = design_named(name)
    arena = preset_named(design.preset)
    learning = LearningSettings(recipe=recipe_for(design.vocabulary)).changed(**OPTIONS)
    learner = train(
        TrainConfig(out=folder, seed=SEED, frames=version * 100, evaluate_every_frames=0),
        learning.network.for_world(world_of(arena, design)),
        learning.learner,
        ReachTask(arena, design, SEED),
        np.array(arena.joint_speed_limits),
        training_programs(design),
    )
    assert learner.counters.updates > 200
    return next(one.tensors for one in learner.published if one.version == version)


def assert_same_as_the_loop(there: PolicySnapshot, folder: Path, design: str = "2-L") -> None:
    here = in_process(folder, there.version, design)
    assert list(there.tensors) == list(here)
    for name, tensor in here.items():
        assert np.array_equal(there.tensors[name], tensor), name


@pytest.mark.parametrize(("compose", "design"), [(False, "push-2"), (True, "2-L")])
def test_the_graph_and_the_loop_learn_the_same_bits(tmp_path, compose, design):
    given = parameters(sim_node={"eval_every_episodes": 1, "design": design})
    there = over_the_graph(tmp_path / "graph", EPISODES, given, compose)
    assert_same_as_the_loop(there, tmp_path / "loop", design)


def test_a_resumed_graph_learns_the_same_bits_as_the_loop(tmp_path):
    out = {"out": str(tmp_path / "run")}
    over_the_graph(tmp_path / "first", EPISODES, parameters(learner_node=out))
    reached = read_metadata(tmp_path / "run" / "checkpoint")
    episodes = reached["counters"]["episodes"]
    given = parameters(sim_node={"first_episode": episodes}, learner_node={**out, "resume": True})
    there = over_the_graph(tmp_path / "second", episodes + 2, given)
    assert_same_as_the_loop(there, tmp_path / "loop")
