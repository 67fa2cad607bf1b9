"""Roles: what is moved receives messages, its target sends them."""

import numpy as np
import pytest
import torch

from helpers import formulas
from pa_ros.language import Vocabulary, parse
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import family_of
from pa_ros.networks.parameters import actor_shapes, initial_actor
from pa_ros.networks.programmable import ProgrammableActor
from pa_ros.world.programs import ProgramTable
from pa_ros.world.schema import PUSHING
from pa_ros.world.world import World

WORDS = Vocabulary.of(shape=("CUBE", "SPHERE", "PLACE"), color=("RED", "BLUE"))
TEXTS = (
    "NEAR(HAND, RED)",
    "NEAR(AND(RED, CUBE), AND(BLUE, PLACE))",
    "NEAR(OR(RED, SPHERE), NOT(CUBE))",
    "NEAR(SPHERE, HAND)",
)


def network(vocabulary: Vocabulary, family: str = "programmable") -> NetworkConfig:
    world = World(PUSHING, vocabulary, joints=6)
    config = NetworkConfig(world=world, family=family, hidden=12, attention=5)
    return config.changed(self_weight=0.03, upper_layers=1)


def table_of(config: NetworkConfig, *texts: str) -> ProgramTable:
    table = ProgramTable(config.vocabulary)
    for text in texts:
        table.add(parse(text, config.vocabulary))
    return table


@pytest.mark.parametrize("family", ["programmable", "true-properties"])
def test_a_batch_of_programs_is_what_the_formulas_say(family: str) -> None:
    config = network(WORDS.moving("PLACE"), family)
    rng = np.random.default_rng(0)
    tensors = {k: v * 3 for k, v in initial_actor(config, rng).items()}
    actor = ProgrammableActor(config).double()
    actor.load_state_dict({name: torch.from_numpy(value) for name, value in tensors.items()})
    looks = [
        PUSHING.features({"shape": s, "color": c})
        for s in ("CUBE", "PLACE")
        for c in ("RED", "BLUE")
    ]
    objects = torch.tensor(np.stack([np.zeros_like(looks[0]), *looks])[None].repeat(3, 0)).double()
    objects[..., :7] = torch.randn(3, 5, 7)
    arm = torch.randn(3, config.world.arm_features).double()
    table, rows = table_of(config, *TEXTS), torch.tensor([[0, 1], [2, 3], [1, 1]])
    codes = [torch.from_numpy(code).long()[rows] for code in family_of(config).codes(table)]
    got = actor(objects, arm, family_of(config).programs(*codes), 0)
    seen = formulas.Scenes(objects, arm, table.programs, rows)
    torch.testing.assert_close(got, formulas.actor(config, formulas.parameters(tensors), seen))


def test_roles_add_no_tensors() -> None:
    hand, moving = network(WORDS), network(WORDS.moving("PLACE"))
    assert actor_shapes(hand).keys() == actor_shapes(moving).keys()
