"""The fused update and actor where programs avoid a set."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.fused_settings import VOCABULARY, Setting, check_gradients, make_batch, setting
from pa_ros.language import MIN_MAX, PRODUCT, Logic, parse
from pa_ros.native.engine import FusedActor
from pa_ros.networks.torch_actor import TorchActor
from pa_ros.world.world import World

AVOIDING = VOCABULARY.avoiding()
TEXTS = (
    "AVOID(BLUE, NEAR(HAND, AND(RED, CUBE)))",
    "AVOID(NOT(AND(RED, CUBE)), NEAR(HAND, AND(RED, CUBE)))",
    "AVOID(OR(GREEN, AND(BLUE, SPHERE)), NEAR(HAND, RED))",
    "NEAR(HAND, OR(RED, BLUE))",
)


def avoiding(kind: str = "programmable", **sizes: object) -> Setting:
    made = setting(kind, vocabulary=AVOIDING, **sizes)  # type: ignore[arg-type]
    for text in TEXTS:
        made.table.add(parse(text, AVOIDING))
    return made


@pytest.mark.parametrize("kind", ["programmable", "distilled-critic", "true-properties"])
@pytest.mark.parametrize(("objects", "programs", "upper"), [(2, 1, 0), (9, 5, 1), (7, 1, 0)])
def test_gradients_where_programs_avoid(kind: str, objects: int, programs: int, upper: int) -> None:
    made = avoiding(kind, hidden=33, self_weight=0.03, upper_layers=upper)
    rng = np.random.default_rng(objects)
    check_gradients(made, make_batch(rng, 13, objects, programs, len(made.table)))
    many = make_batch(rng, 70, objects, programs, len(made.table))
    check_gradients(made, many, engine__threads=2)


@pytest.mark.parametrize("logic", [PRODUCT, MIN_MAX])
def test_the_actor_acts_on_what_is_avoided(logic: Logic) -> None:
    made = avoiding()
    actor, reference = (kind(made.network, made.actor, logic) for kind in (FusedActor, TorchActor))
    batch = make_batch(np.random.default_rng(0), 1, 5, 1, 1)
    for program in made.table.programs:
        seen = batch.objects[0], batch.arm[0], program, 0
        action = actor.act(*seen)
        np.testing.assert_allclose(action, reference.act(*seen), atol=2e-6)
        np.testing.assert_allclose(actor.degrees(*seen), reference.degrees(*seen), atol=2e-6)
        alone = actor.act(batch.objects[0], batch.arm[0], program.relation_alone, 0)
        assert (action == alone).all() == (program.avoided is None)


def test_only_worlds_that_avoid_have_its_tensors() -> None:
    made, plain = avoiding(), setting()
    added = {"avoid.0.weight", "avoid.0.bias", "avoid.1.weight"}
    assert made.actor.keys() - plain.actor.keys() == added
    world = made.network.world
    assert World.from_json(world.to_json()) == world
    without = replace(world, vocabulary=replace(world.vocabulary, avoids=False))
    assert without.digest == plain.network.world.digest != world.digest
