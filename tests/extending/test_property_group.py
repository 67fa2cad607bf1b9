"""A property group from outside the package: seen, named, learned about, over the graph too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.graph import learned_over_the_graph
from pa_ros.arena import (
    ArenaConfig,
    ReachTask,
    conditions_for,
    design_named,
    preset_named,
    training_programs,
    world_of,
)
from pa_ros.arena.designs import Design
from pa_ros.arena.gym_env import ReachEnv
from pa_ros.arena.render import top_view
from pa_ros.cli.main import main
from pa_ros.core import extensions
from pa_ros.language import parse
from pa_ros.learning.checkpoints import load_policy
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.loop import train
from pa_ros.learning.protocols import LearningSettings
from pa_ros.tools.launch_params import Parameters

SIZES = str(Path(__file__).with_name("sizes.py"))
QUICK: dict[str, Any] = {
    "learner.replay.warmup_frames": 100,
    "learner.replay.batch_size": 16,
    "network.hidden": 32,
    "learner.detectors.sparsity": 0,
}  # what is read leaves its trace
FRAMES = 300


@pytest.fixture
def design() -> Design:
    extensions.load([SIZES])
    return design_named("sizes")


@pytest.fixture
def arena() -> ArenaConfig:
    return preset_named("fast")


def test_blocks_differ_in_size_where_they_are_simulated_and_where_they_are_seen(
    design: Design, arena: ArenaConfig
) -> None:
    task = ReachTask(arena, design, seed=0)
    assert task.world.schema.feature_names[-1] == "size_m" and task.world.object_features == 17
    observation, _ = task.reset(0)
    model, seen = task.simulation.model, set()
    for i, block in enumerate(task.episode.blocks):
        edge = {"SMALL": 0.04, "LARGE": 0.08}[block.kind["size"]]
        np.testing.assert_allclose(model.geom(f"block{i}").size, edge / 2)
        assert observation.objects[i + 1, -1] == np.float32(edge)
        seen.add(edge)
    assert seen == {0.04, 0.08}
    for _ in range(10):  # they lie where they were put
        observation, _ = task.step(np.zeros(6))
    lengths = task.simulation.positions[1:, 2]
    edges = observation.objects[1:, -1]
    np.testing.assert_allclose(lengths, edges / 2, atol=2e-4)
    assert top_view(task, 120).shape == (120, 120, 3)


def test_the_verifier_tells_sizes_apart(design: Design, arena: ArenaConfig) -> None:
    task = ReachTask(arena, design, seed=1)
    task.reset(0)
    for word in ("SMALL", "LARGE"):
        task.set_program(parse(f"NEAR(HAND, {word})", design.vocabulary))
        named = {task.episode.blocks[i - 1].kind["size"] for i in task.verifier.targets}
        assert named == {word}


def test_conditions_are_those_of_every_group(design: Design, arena: ArenaConfig) -> None:
    names = conditions_for(design)
    assert {"only-size", "not-size", "only-color", "not-color", "depth-3"} <= set(names)
    assert not {"not-shape", "ignore-new", "reach-new-size"} & set(names)  # one shape, none new
    task = ReachTask(arena, design, seed=2)
    for name in names:
        task.reset(0, name)
        assert len(task.verifier.targets) == 1
    task.reset(0, "not-size")
    assert "NOT(SMALL)" in str(task.program) or "NOT(LARGE)" in str(task.program)


def test_it_is_learned_about_in_process(design: Design, arena: ArenaConfig, tmp_path: Path) -> None:
    learning, world = LearningSettings().changed(**QUICK), world_of(arena, design)
    learner = train(
        TrainConfig(out=tmp_path, seed=1, frames=FRAMES, evaluate_every_frames=0),
        learning.network.for_world(world),
        learning.learner,
        ReachTask(arena, design, seed=1),
        np.array(arena.joint_speed_limits),
        training_programs(design),
    )
    assert learner.engine.name == "fused" and learner.counters.updates == FRAMES - 100
    arrays = learner.engine.tensors()
    assert arrays["actor.detectors.weight"].shape == (len(design.vocabulary.words), 17 + 18)
    column = world.schema.slices["size"]
    rows = [design.vocabulary.row[word] for word in ("SMALL", "LARGE")]
    learned = arrays["actor.detectors.weight"][rows, column]
    assert np.abs(learned).min() > 0  # they began at 0: the number is read
    sizes = learner.replay.arrays["objects"][: learner.replay.rows, 1:, column]
    assert set(np.unique(sizes)) == {np.float32(0.04), np.float32(0.08)}
    assert load_policy(tmp_path / "checkpoint").world_digest == world.digest


def test_the_command_line_trains_on_it(tmp_path: Path) -> None:
    given = ["--extension", SIZES, "train", "--design", "sizes", "--frames", "200"]
    assert main([*given, "--eval-every", "0", "--out", str(tmp_path / "run")]) == 0
    assert main(["train", "--design", "size", "--out", str(tmp_path / "x"), "--frames", "1"]) == 2


def test_gymnasium_has_it(design: Design) -> None:
    env = ReachEnv(design=design)
    flat, _ = env.reset(seed=0)
    assert flat.shape == (18 + 17 * 4 + len(design.vocabulary.words),)


@pytest.mark.graph
def test_it_is_learned_about_over_the_graph(
    design: Design, arena: ArenaConfig, tmp_path: Path
) -> None:
    """The arena alone knows the extension; agent and learner are told of the world."""
    given: Parameters = {
        "sim_node": {"design": "sizes", "extensions": [SIZES]},
        "agent_node": {"learning": True, "agent_id": "agent"},
        "learner_node": {**QUICK},
    }

    policy, _ = learned_over_the_graph(tmp_path, given, FRAMES // 100)
    assert policy.world_digest == world_of(arena, design).digest
    size = world_of(arena, design).schema.slices["size"]
    assert np.abs(policy.tensors["detectors.weight"][-2:, size]).min() > 0
