"""Settings of learning: what contradicts or names nothing is rejected in one line, and what follows
from another setting is computed."""

from typing import Any

import pytest

from helpers.learners import DESIGN, WORLD
from pa_ros.arena import design_named, training_programs
from pa_ros.core.errors import ConfigError
from pa_ros.learning.config import RelabelingConfig
from pa_ros.learning.learner import Learner
from pa_ros.learning.recipes import LearningSettings, recipe_for


def test_several_programs_need_relabeling() -> None:
    assert RelabelingConfig(rule="all-goals", programs_per_transition=2)
    with pytest.raises(ConfigError, match="expected 1 without relabeling, got 2"):
        RelabelingConfig(programs_per_transition=2)


@pytest.mark.parametrize("name", ["recipe", "algorithm"])
def test_a_name_that_is_no_text_is_rejected(name: str) -> None:
    values: dict[str, Any] = {name: {}}
    with pytest.raises(ConfigError, match=rf"{name}: expected one of \[.*\], got {{}}"):
        LearningSettings(**values)


@pytest.mark.parametrize(
    ("recipe", "discount", "value"),
    [
        ("paper", 0.99, -100.0),
        ("ours", 0.95, -20.0),
        ("deep", 0.95, -20.0),
        ("push", 0.97, -33.0),
        ("push", 0.985, -66.0),
        ("ours", 0.9, -10.0),
    ],
)
def test_the_critic_starts_at_the_value_of_never_being_rewarded(recipe, discount, value) -> None:
    given: dict[str, Any] = {"recipe": recipe, "learner.updates.discount": discount}
    learning = LearningSettings(**given)
    network = learning.network.for_world(WORLD)
    learner = Learner(network, learning.learner, training_programs(DESIGN), seed=0)
    assert learner.engine.tensors()["critic.output.bias"] == [value]


@pytest.mark.parametrize(
    ("name", "relations", "recipe"),
    [("2-L", ["NEAR"], "ours"), ("2-L", ["NEAR", "LEFT"], "deep"),
     ("3-D-avoid", ["NEAR"], "deep"), ("push-3D", ["NEAR"], "push"),
     ("zones-8", ["NEAR"], "entries")],
)  # fmt: skip
def test_programs_decide_the_recipe(name: str, relations: list[str], recipe: str) -> None:
    assert recipe_for(design_named(name).vocabulary.asking(*relations)) == recipe


def test_the_recipe_may_be_given_by_its_older_name() -> None:
    older: dict[str, Any] = {"protocol": "paper", "recipe": "push"}  # beside a design's own
    assert LearningSettings(**older) == LearningSettings(recipe="paper")
