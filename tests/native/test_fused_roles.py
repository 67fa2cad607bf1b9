"""The fused update and actor where programs move objects, and with upper layers."""

from typing import Any

import numpy as np
import pytest

from helpers.fused_settings import VOCABULARY, Setting, check_gradients, make_batch, setting
from pa_ros.language import parse
from pa_ros.native.engine import FusedActor
from pa_ros.networks.torch_actor import TorchActor

MOVING = VOCABULARY.moving()
TEXTS = (
    "NEAR(AND(RED, CUBE), BLUE)",
    "NEAR(OR(BLUE, SPHERE), NOT(AND(RED, CUBE)))",
    "NEAR(RED, HAND)",
    "NEAR(RED, RED)",
)


def moving(kind: str = "programmable", **sizes: Any) -> Setting:
    made = setting(kind, vocabulary=MOVING, **sizes)
    for text in TEXTS:
        made.table.add(parse(text, MOVING))
    return made


@pytest.mark.parametrize("kind", ["programmable", "distilled-critic", "true-properties"])
@pytest.mark.parametrize("upper", [0, 2])
@pytest.mark.parametrize(("objects", "programs"), [(2, 1), (9, 5), (7, 1)])
def test_gradients_where_programs_move_objects(
    kind: str, upper: int, objects: int, programs: int
) -> None:
    made = moving(kind, hidden=33, upper_layers=upper, self_weight=0.03)
    arm = made.network.world.arm_features
    rng = np.random.default_rng(objects)
    check_gradients(made, make_batch(rng, 13, objects, programs, len(made.table), arm))
    many = make_batch(rng, 70, objects, programs, len(made.table), arm)
    check_gradients(made, many, engine__threads=2)


@pytest.mark.parametrize("relations", [("NEAR",), ("NEAR", "ABOVE")])
def test_gradients_with_upper_layers_alone(relations: tuple[str, ...]) -> None:
    made = setting(upper_layers=1, relations=relations)
    arm = made.network.world.arm_features
    check_gradients(made, make_batch(np.random.default_rng(0), 20, 5, 2, len(made.table), arm))


def test_the_actor_acts_by_roles() -> None:
    made = moving(upper_layers=1)
    actor, reference = FusedActor(made.network, made.actor), TorchActor(made.network, made.actor)
    batch = make_batch(np.random.default_rng(0), 1, 5, 1, 1, made.network.world.arm_features)
    for program in made.table.programs:
        seen = batch.objects[0], batch.arm[0], program, 0
        np.testing.assert_allclose(actor.act(*seen), reference.act(*seen), atol=2e-6)
        np.testing.assert_allclose(actor.degrees(*seen), reference.degrees(*seen), atol=2e-6)
