"""A custom skill is one class, which a design names."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from pa_ros.arena import ReachTask, conditions_for, design_named, preset_named, scripted_action
from pa_ros.arena.conditions import Condition
from pa_ros.arena.designs import Design
from pa_ros.arena.reaching import Reaching
from pa_ros.arena.skills import SKILLS
from pa_ros.core.errors import ConfigError


class Resting(Reaching):
    """Blocks lie there, and the reference does nothing."""

    preset = "paper"

    def conditions(self, design: Design) -> Iterator[Condition]:
        yield replace(self.train(design), n_blocks=2)

    def script(self, task: ReachTask) -> np.ndarray:
        return np.zeros(task.config.joints)


SKILLS.register("rest", Resting())


def test_a_design_has_the_conditions_the_reference_and_the_preset_of_its_skill() -> None:
    design = replace(design_named("2-L"), name="resting", skill_name="rest")
    task = ReachTask(preset_named(design.preset), design, seed=0)
    task.reset(0)
    assert conditions_for(design) == ("train",) and task.config.preset == "paper"
    assert len(task.episode.blocks) == 2 and not scripted_action(task).any()


def test_an_unknown_skill_is_rejected() -> None:
    with pytest.raises(ConfigError, match="unknown skill: expected one of .*'reach'"):
        _ = replace(design_named("2-L"), skill_name="juggle").skill
