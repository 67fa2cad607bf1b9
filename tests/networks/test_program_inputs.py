"""What programs are to r: relations, one or several in a batch, and roles (what is moved receives
messages, its target sends them)."""

import numpy as np
import pytest
import torch

from helpers import formulas
from pa_ros.arena import PRESETS, design_named, world_of
from pa_ros.language import Vocabulary, parse
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import family_of
from pa_ros.networks.parameters import actor_shapes, critic_shapes, initial_actor
from pa_ros.networks.programmable import ProgrammableActor, Programs
from pa_ros.world.programs import ProgramTable
from pa_ros.world.relation import RELATIONS
from pa_ros.world.schema import PUSHING
from pa_ros.world.world import World

THREE = ("NEAR", "ABOVE", "LEFT_OF")
RELATED = ("ABOVE(HAND, RED)", "NEAR(HAND, RED)", "LEFT_OF(HAND, AND(BLUE, CUBE))",
           "ABOVE(HAND, CUBE)")  # fmt: skip
WORDS = Vocabulary.of(shape=("CUBE", "SPHERE", "PLACE"), color=("RED", "BLUE"))
MOVES = ("NEAR(HAND, RED)", "NEAR(AND(RED, CUBE), AND(BLUE, PLACE))",
         "NEAR(OR(RED, SPHERE), NOT(CUBE))", "NEAR(SPHERE, HAND)")  # fmt: skip


def network(*relations: str) -> NetworkConfig:
    world = world_of(PRESETS["fast"], design_named("2-L").with_relations(*relations))
    return NetworkConfig(world=world, hidden=12, attention=5)


def moving(vocabulary: Vocabulary, family: str = "programmable") -> NetworkConfig:
    world = World(PUSHING, vocabulary, joints=6)
    config = NetworkConfig(world=world, family=family, hidden=12, attention=5)
    return config.changed(self_weight=0.03, upper_layers=1)


def programs(config: NetworkConfig, rows: list[list[int]], texts: tuple[str, ...]) -> Programs:
    """Rows [B, K] of a table of some texts."""
    table = ProgramTable(config.vocabulary)
    for text in texts:
        table.add(parse(text, config.vocabulary))
    codes = [torch.from_numpy(code).long() for code in family_of(config).codes(table)]
    made: Programs = family_of(config).programs(*(code[torch.tensor(rows)] for code in codes))
    return made


def test_one_relation_alone_is_no_input() -> None:
    for name in {*RELATIONS} - {"HOLD", "ON"}:
        shapes = actor_shapes(network(name)) | critic_shapes(network(name))
        assert "relation.weight" not in shapes
        assert not hasattr(ProgrammableActor(network(name)), "relation")
    assert actor_shapes(network(*THREE))["relation.weight"] == (12, 3)
    assert critic_shapes(network(*THREE))["relation.weight"] == (12, 3)


@pytest.mark.parametrize("relations", [THREE, ("NEAR", "ABOVE")])
def test_initial_weights_of_what_they_share_are_drawn_first(relations: tuple[str, ...]) -> None:
    """So that a seed says the same of detectors and layers whatever relations there are."""
    several = initial_actor(network(*relations), np.random.default_rng(0))
    alone = initial_actor(network("ABOVE"), np.random.default_rng(0))  # also with the hand's pose
    names = list(several)
    for name in names[: names.index("relation.weight")]:
        np.testing.assert_array_equal(several[name], alone[name])


@pytest.mark.parametrize("family", ["programmable", "true-properties"])
@pytest.mark.parametrize(
    ("words", "texts"), [(WORDS.moving("PLACE"), MOVES), (WORDS.asking(*THREE), RELATED)]
)
def test_a_batch_of_different_programs_is_what_the_formulas_say(words, texts, family) -> None:
    config = moving(words, family)
    rng = np.random.default_rng(0)
    tensors = {k: v * 3 for k, v in initial_actor(config, rng).items()}
    actor = ProgrammableActor(config).double()
    actor.load_state_dict({name: torch.from_numpy(value) for name, value in tensors.items()})
    kinds = [(s, c) for s in ("CUBE", "PLACE") for c in ("RED", "BLUE")]
    looks = [PUSHING.features({"shape": s, "color": c}) for s, c in kinds]
    objects = torch.tensor(np.stack([np.zeros_like(looks[0]), *looks])[None].repeat(3, 0)).double()
    objects[..., :7] = torch.randn(3, 5, 7)
    arm, rows = torch.randn(3, config.world.arm_features).double(), [[0, 1], [2, 3], [1, 1]]
    got = actor(objects, arm, programs(config, rows, texts), 0)
    parsed = [parse(text, config.vocabulary) for text in texts]
    seen = formulas.Scenes(objects, arm, parsed, torch.tensor(rows))
    torch.testing.assert_close(got, formulas.actor(config, formulas.parameters(tensors), seen))


def test_roles_add_no_tensors() -> None:
    hand, moves = moving(WORDS), moving(WORDS.moving("PLACE"))
    assert actor_shapes(hand).keys() == actor_shapes(moves).keys()
