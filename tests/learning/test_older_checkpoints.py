"""Checkpoints of older versions: their agents act, though not all of their settings are known."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from helpers.worlds import run
from pa_ros.arena import design_named, preset_named, world_of
from pa_ros.arena.conditions import training_programs
from pa_ros.evaluation.scoring.agents import load_agent
from pa_ros.learning.checkpoints import find_checkpoint, read_metadata, restore
from pa_ros.learning.edition2 import scoring_of
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.learner import Learner
from pa_ros.learning.protocols import protocol_named
from pa_ros.networks.config import actor_config
from pa_ros.networks.inference import TorchActor
from pa_ros.world import Scoring

OLD = Path(__file__).with_name("version-0.1")  # what version 0.1 shipped as 2-L


def test_an_agent_of_0_1_acts() -> None:
    assert read_metadata(OLD)["format"] == 3
    agent = load_agent(OLD)
    config = actor_config(agent.snapshot.architecture)
    assert (agent.design.name, agent.arena.preset) == ("2-L", "fast")
    world = world_of(preset_named("fast"), design_named("2-L"))
    assert agent.snapshot.world_digest == world.digest
    actor = TorchActor(config, agent.snapshot.tensors)
    program = training_programs(design_named("2-L"))[0]
    objects = np.zeros((3, 16), np.float32)
    assert np.isfinite(actor.act(objects, np.zeros(18, np.float32), program, 0)).all()


def test_its_learner_does_not_go_on_and_the_refusal_says_which_setting_is_gone() -> None:
    world = world_of(preset_named("fast"), design_named("2-L"))
    ours = protocol_named("ours")
    learner = Learner(
        ours.network_config(world), ours.learner, training_programs(design_named("2-L")), seed=0
    )
    with pytest.raises(CheckpointError, match="its agents act, its learner does not go on .*_clip"):
        restore(OLD, learner)


def test_the_scoring_of_a_0_2_checkpoint_is_todays() -> None:
    reward = "reward=Sparse(satisfied=1.0, otherwise=-1.0)"
    then = {"scoring": f"Scoring(near_threshold_m=0.2, {reward})"}
    assert scoring_of(then) == repr(Scoring())
    assert scoring_of({"scoring": f"Scoring(near_threshold_m=0.25, {reward})"}) == repr(
        Scoring({"NEAR": 0.25})
    )
    assert scoring_of({"scoring": repr(Scoring())}) == repr(Scoring())


def saying(out: Path, **changed: object) -> None:
    """Let a run's checkpoint say other facts; None: not say one."""
    metadata = find_checkpoint(out / "checkpoint") / "metadata.json"
    metadata.with_name("SHA256SUMS").unlink(missing_ok=True)
    values = json.loads(metadata.read_text())
    extra = values["extra"] | changed
    values["extra"] = {name: value for name, value in extra.items() if value is not None}
    metadata.write_text(json.dumps(values))


def test_a_run_that_did_not_keep_its_rewards_has_one_row_without_them(tmp_path: Path) -> None:
    run(tmp_path, 60, evaluate_every_frames=40)
    saying(tmp_path, reward_sum=None, reward_steps=None)
    run(tmp_path, 70, resume=True, evaluate_every_frames=40)
    run(tmp_path, 160, resume=True, evaluate_every_frames=40)
    with (tmp_path / "progress.csv").open(newline="") as file:
        means = [float(row["behaviour.reward_per_step"]) for row in csv.DictReader(file)]
    assert np.isnan(means).tolist() == [False, True, False, False]


@pytest.mark.parametrize("fact", [{"reward_sum": "x"}, {"reward_steps": -1}, {"reward_steps": 0.5}])
def test_rewards_that_are_none_are_refused(tmp_path: Path, fact: dict[str, object]) -> None:
    run(tmp_path, 20)
    saying(tmp_path, **fact)
    with pytest.raises(CheckpointError, match=f"{next(iter(fact))}: expected"):
        run(tmp_path, 40, resume=True)
