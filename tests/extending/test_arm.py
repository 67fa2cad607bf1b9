"""A custom arm moves, and agents learn with it."""

from pathlib import Path

import numpy as np
import pytest

from helpers.learners import DESIGN, trained
from pa_ros.arena import (
    ReachTask,
    mean_reward,
    preset_named,
    random_policy,
    scripted_action,
    world_of,
)
from pa_ros.core import extensions
from pa_ros.learning.checkpoints import load_policy

CRANE = str(Path(__file__).with_name("crane.py"))
ALL = {"crane": 4, "panda": 7}


@pytest.fixture(autouse=True)
def extended() -> None:
    extensions.load([CRANE])


def test_it_moves_and_the_script_scores_well() -> None:
    task = ReachTask(preset_named("fast", "crane"), DESIGN, seed=0)
    assert mean_reward(task, scripted_action, 10) > 0.7
    assert mean_reward(task, random_policy(0), 10) < -0.8
    observation, _ = task.reset(0)
    assert task.world.arm(observation).shape == (12,)


@pytest.mark.parametrize(("arm", "joints"), ALL.items())
def test_it_is_learned_with_in_process(arm: str, joints: int, tmp_path: Path) -> None:
    learner = trained(tmp_path, arm=arm)
    assert learner.engine.name == "fused" and learner.counters.updates == 200
    policy = load_policy(tmp_path / "checkpoint")
    assert policy.world_digest == world_of(preset_named("fast", arm), DESIGN).digest
    tensors = policy.tensors
    assert tensors["output.weight"].shape[0] == tensors["output.bias"].shape[0] == joints
    assert tensors["detectors.weight"].shape[1] == 16 + 3 * joints
    assert np.abs(tensors["detectors.weight"]).max() > 0
    actions = learner.replay.arrays["action"][: learner.replay.rows]
    assert actions.shape[1] == joints and (actions.std(axis=0) > 0).all()
