"""Checkpoints of version 0.1 are read: the shipped policies are such."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.learning import edition1
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.checkpoints import SHIPPED, read_metadata
from pa_ros.learning.edition2 import scoring_of
from pa_ros.learning.protocols import protocol_named
from pa_ros.world import Scoring


def test_the_settings_of_a_0_1_checkpoint_are_todays() -> None:
    written = json.loads((SHIPPED / "3-D" / "metadata.json").read_text())
    assert written["format"] == edition1.FORMAT
    then = json.loads(written["learner"])
    now = DPGConfig.from_json(read_metadata(Path("shipped:3-D"))["learner"])
    assert now.exploration.sigma == then["noise_sigma"] == 1.0
    assert now.schedule.trajectory_steps == then["stretch_steps"] == 100
    assert now.detectors.decay == then["detector_decay"] == 0.5
    assert now == protocol_named("ours").learner.changed(
        **{
            "detectors.geometry_decay": then["geometry_decay"],
            "relabeling.property_dropout": then.get("property_dropout", 0.0),
        }
    )


@pytest.mark.parametrize("learner", ["[]", "{", "{}", '{"near_threshold": 0.2, "speed": 1}'])
def test_what_is_not_of_0_1_is_refused(learner) -> None:
    with pytest.raises(ConfigError, match=r"settings of version 0\.1"):
        edition1.read({"learner": learner})


def test_the_scoring_of_a_0_2_checkpoint_is_todays() -> None:
    reward = "reward=Sparse(satisfied=1.0, otherwise=-1.0)"
    then = {"scoring": f"Scoring(near_threshold_m=0.2, {reward})"}
    assert scoring_of(then) == repr(Scoring())
    assert scoring_of({"scoring": f"Scoring(near_threshold_m=0.25, {reward})"}) == repr(
        Scoring({"NEAR": 0.25})
    )
    assert scoring_of({"scoring": repr(Scoring())}) == repr(Scoring())
