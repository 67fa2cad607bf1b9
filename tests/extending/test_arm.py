"""An arm from outside the package: it moves, is learned with in process and over the graph."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.graph import learned_over_the_graph
from pa_ros.arena import (
    ReachTask,
    design_named,
    mean_reward,
    preset_named,
    random_policy,
    scripted_action,
    training_programs,
    world_of,
)
from pa_ros.cli.main import main
from pa_ros.core import extensions
from pa_ros.core.experience import PolicySnapshot
from pa_ros.learning.checkpoints import load_policy
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.loop import train
from pa_ros.learning.protocols import LearningSettings
from pa_ros.tools.launch_params import Parameters

CRANE = str(Path(__file__).with_name("crane.py"))
QUICK: dict[str, Any] = {
    "learner.replay.warmup_frames": 100,
    "learner.replay.batch_size": 16,
    "network.hidden": 32,
}
FRAMES = 300
DESIGN = design_named("2-L")
ALL = {"crane": 4, "panda": 7}


@pytest.fixture(autouse=True)
def extended() -> None:
    extensions.load([CRANE])


def test_it_moves_and_its_script_scores() -> None:
    task = ReachTask(preset_named("fast", "crane"), DESIGN, seed=0)
    assert mean_reward(task, scripted_action, 10) > 0.7
    assert mean_reward(task, random_policy(0), 10) < -0.8
    observation, _ = task.reset(0)
    assert task.world.arm(observation).shape == (12,)


@pytest.mark.parametrize(("arm", "joints"), ALL.items())
def test_it_is_learned_with_in_process(arm: str, joints: int, tmp_path: Path) -> None:
    arena = preset_named("fast", arm)
    learning, world = LearningSettings().changed(**QUICK), world_of(arena, DESIGN)
    learner = train(
        TrainConfig(out=tmp_path, seed=1, frames=FRAMES, evaluate_every_frames=0, arm=arm),
        learning.network.for_world(world),
        learning.learner,
        ReachTask(arena, DESIGN, seed=1),
        np.array(arena.joint_speed_limits),
        training_programs(DESIGN),
    )
    assert learner.engine.name == "fused" and learner.counters.updates == FRAMES - 100
    policy = load_policy(tmp_path / "checkpoint")
    assert policy.world_digest == world.digest
    check(policy, joints)
    actions = learner.replay.arrays["action"][: learner.replay.rows]
    assert actions.shape[1] == joints and (actions.std(axis=0) > 0).all()


def check(policy: PolicySnapshot, joints: int) -> None:
    """An action for each joint, and what every joint's angle and speed are read by was learned."""
    tensors = policy.tensors
    assert tensors["output.weight"].shape[0] == tensors["output.bias"].shape[0] == joints
    assert tensors["detectors.weight"].shape[1] == 16 + 3 * joints
    assert np.abs(tensors["detectors.weight"]).max() > 0


def test_the_command_line_learns_with_it_and_knows_it_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "run")
    given = ["--extension", CRANE, "train", "--arm", "crane", "--frames", "200", "--out", out]
    assert main([*given, "--eval-every", "0"]) == 0
    assert main(["eval", "--checkpoint", out, "--episodes", "2"]) == 0  # it says its arm
    other = ["train", "--arm", "panda", "--frames", "300", "--out", out, "--resume"]
    assert main(other) == 2
    assert "arm: expected 'panda', got 'crane'" in capsys.readouterr().err


def test_an_unknown_arm_is_refused_with_the_known_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", "--arm", "elbow", "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "--arm: expected one of ['jaco', 'panda'" in error and "got elbow" in error


@pytest.mark.graph
@pytest.mark.parametrize(("arm", "joints"), ALL.items())
def test_it_is_learned_with_over_the_graph(arm: str, joints: int, tmp_path: Path) -> None:
    """The arena alone knows the extension; agent and learner are told of the joints."""
    given: Parameters = {
        "sim_node": {"arm": arm, **({"extensions": [CRANE]} if arm == "crane" else {})},
        "agent_node": {"learning": True, "agent_id": "agent"},
        "learner_node": {**QUICK},
    }

    policy, arena = learned_over_the_graph(tmp_path, given, FRAMES // 100)
    config = preset_named("fast", arm)
    assert (arena.arm, len(arena.joint_names)) == (arm, joints)
    assert arena.speed_limits == config.joint_speed_limits
    assert policy.world_digest == world_of(config, DESIGN).digest
    check(policy, joints)
