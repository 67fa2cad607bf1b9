"""The fused update and actor where programs move objects or avoid a set, and with upper layers."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from helpers.fused_settings import VOCABULARY, check_batches, check_gradients, make_batch, setting
from pa_ros.language import MIN_MAX, PRODUCT, Logic
from pa_ros.native.engine import FusedActor
from pa_ros.networks.torch_actor import TorchActor
from pa_ros.world.world import World

KINDS = pytest.mark.parametrize("kind", ["programmable", "distilled-critic", "true-properties"])
MOVING: dict[str, Any] = {
    "vocabulary": VOCABULARY.moving(),
    "texts": (
        "NEAR(AND(RED, CUBE), BLUE)",
        "NEAR(OR(BLUE, SPHERE), NOT(AND(RED, CUBE)))",
        "NEAR(RED, HAND)",
        "NEAR(RED, RED)",
    ),
}
AVOIDING: dict[str, Any] = {
    "vocabulary": VOCABULARY.avoiding(),
    "texts": (
        "AVOID(BLUE, NEAR(HAND, AND(RED, CUBE)))",
        "AVOID(NOT(AND(RED, CUBE)), NEAR(HAND, AND(RED, CUBE)))",
        "AVOID(OR(GREEN, AND(BLUE, SPHERE)), NEAR(HAND, RED))",
        "NEAR(HAND, OR(RED, BLUE))",
    ),
}


@KINDS
@pytest.mark.parametrize("upper", [0, 2])
@pytest.mark.parametrize(("objects", "programs"), [(2, 1), (9, 5), (7, 1)])
def test_gradients_where_programs_move_objects(kind, upper, objects, programs) -> None:
    made = setting(kind, **MOVING, hidden=33, upper_layers=upper, self_weight=0.03)
    check_batches(made, objects, programs)


@KINDS
@pytest.mark.parametrize(("objects", "programs", "upper"), [(2, 1, 0), (9, 5, 1), (7, 1, 0)])
def test_gradients_where_programs_avoid(kind, objects, programs, upper) -> None:
    made = setting(kind, **AVOIDING, hidden=33, upper_layers=upper, self_weight=0.03)
    check_batches(made, objects, programs)


@pytest.mark.parametrize("relations", [("NEAR",), ("NEAR", "ABOVE")])
def test_gradients_with_upper_layers_alone(relations: tuple[str, ...]) -> None:
    made = setting(upper_layers=1, relations=relations)
    arm = made.network.world.arm_features
    check_gradients(made, make_batch(np.random.default_rng(0), 20, 5, 2, len(made.table), arm))


@pytest.mark.parametrize("logic", [PRODUCT, MIN_MAX])
@pytest.mark.parametrize(
    "programs", [MOVING | {"upper_layers": 1}, AVOIDING], ids=["move", "avoid"]
)
def test_the_actor_acts_by_roles_and_on_what_is_avoided(programs, logic: Logic) -> None:
    made = setting(**programs)
    actor, reference = (kind(made.network, made.actor, logic) for kind in (FusedActor, TorchActor))
    batch = make_batch(np.random.default_rng(0), 1, 5, 1, 1, made.network.world.arm_features)
    for program in made.table.programs:
        seen = batch.objects[0], batch.arm[0], program, 0
        action = actor.act(*seen)
        np.testing.assert_allclose(action, reference.act(*seen), atol=2e-6)
        np.testing.assert_allclose(actor.degrees(*seen), reference.degrees(*seen), atol=2e-6)
        alone = actor.act(batch.objects[0], batch.arm[0], program.relation_alone, 0)
        assert (action == alone).all() == (program.avoided is None)


def test_only_worlds_that_avoid_have_its_tensors() -> None:
    made, plain = setting(**AVOIDING), setting()
    added = {"avoid.0.weight", "avoid.0.bias", "avoid.1.weight"}
    assert made.actor.keys() - plain.actor.keys() == added
    world = made.network.world
    assert World.from_json(world.to_json()) == world
    without = replace(world, vocabulary=replace(world.vocabulary, avoids=False))
    assert without.digest == plain.network.world.digest != world.digest
