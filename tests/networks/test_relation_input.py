"""Relations as an input of r: batches that mix them, and worlds that know one alone."""

import numpy as np
import pytest
import torch
from torch import Tensor

from pa_ros.arena import PRESETS, design_named, world_of
from pa_ros.language import parse
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import family_of
from pa_ros.networks.parameters import actor_shapes, critic_shapes, initial_actor, initial_critic
from pa_ros.networks.programmable import ProgrammableActor, ProgrammableCritic, Programs
from pa_ros.world.programs import ProgramTable
from pa_ros.world.relation import RELATIONS

THREE = ("NEAR", "ABOVE", "LEFT_OF")
TEXTS = (
    "ABOVE(HAND, RED)",
    "NEAR(HAND, RED)",
    "LEFT_OF(HAND, AND(BLUE, CUBE))",
    "ABOVE(HAND, CUBE)",
)


def network(*relations: str) -> NetworkConfig:
    world = world_of(PRESETS["fast"], design_named("2-L").with_relations(*relations))
    return NetworkConfig(world=world, hidden=12, attention=5)


def programs(config: NetworkConfig, rows: list[list[int]]) -> Programs:
    """Rows [B, K] of a table of TEXTS."""
    table = ProgramTable(config.vocabulary)
    for text in TEXTS:
        table.add(parse(text, config.vocabulary))
    codes = [
        torch.from_numpy(code).long()[torch.tensor(rows)] for code in family_of(config).codes(table)
    ]
    made: Programs = family_of(config).programs(*codes)
    return made


def scenes(config: NetworkConfig, count: int) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    objects = torch.randn(count, 4, config.world.object_features, generator=generator)
    return objects, torch.randn(count, config.world.arm_features, generator=generator)


def actor_of(config: NetworkConfig) -> ProgrammableActor:
    actor = ProgrammableActor(config)
    tensors = initial_actor(config, np.random.default_rng(1))
    tensors["output.weight"] *= 100.0
    actor.load_state_dict({name: torch.from_numpy(value) for name, value in tensors.items()})
    return actor


def test_a_batch_that_mixes_relations_is_each_program_alone() -> None:
    config = network(*THREE)
    actor, (objects, arm) = actor_of(config), scenes(config, 3)
    rows = [[0, 1], [2, 3], [1, 1]]
    together = actor(objects, arm, programs(config, rows))
    for b, k in np.ndindex(3, 2):
        alone = actor(objects[b : b + 1], arm[b : b + 1], programs(config, [[rows[b][k]]]))
        torch.testing.assert_close(together[b, k], alone[0, 0])


def test_a_relation_is_another_bias_of_r() -> None:
    """ω of receiver and sender, and a one-hot of the relation, under one linear layer."""
    config, one = network(*THREE), network("ABOVE")
    mixed, plain, (objects, arm) = actor_of(config), ProgrammableActor(one), scenes(config, 5)
    weights = mixed.state_dict()
    share = weights.pop("relation.weight")[:, THREE.index("ABOVE")]
    weights["message.0.bias"] = weights["message.0.bias"] + share
    plain.load_state_dict(weights)
    asked = mixed(objects, arm, programs(config, [[0]] * 5))
    table = ProgramTable(one.vocabulary)
    table.add(parse(TEXTS[0], one.vocabulary))
    codes = [torch.from_numpy(code).long()[torch.zeros(5, 1, dtype=torch.int64)]
             for code in family_of(one).codes(table)]  # fmt: skip
    torch.testing.assert_close(asked, plain(objects, arm, family_of(one).programs(*codes)))


def test_only_relations_that_are_asked_for_learn() -> None:
    config = network(*THREE)
    critic, (objects, arm) = ProgrammableCritic(config), scenes(config, 2)
    tensors = initial_critic(config, np.random.default_rng(1))
    critic.load_state_dict({name: torch.from_numpy(value) for name, value in tensors.items()})
    q = critic(objects, arm, programs(config, [[0, 1], [3, 0]]), torch.zeros(2, 6))
    q.square().sum().backward()
    gradient = critic.relation.weight.grad
    assert gradient is not None
    assert (gradient[:, :2].abs().sum(0) > 0).all() and (gradient[:, 2] == 0).all()


def test_one_relation_alone_is_no_input() -> None:
    for name in RELATIONS:
        shapes = actor_shapes(network(name)) | critic_shapes(network(name))
        assert "relation.weight" not in shapes
        assert not hasattr(ProgrammableActor(network(name)), "relation")
    assert actor_shapes(network(*THREE))["relation.weight"] == (12, 3)
    assert critic_shapes(network(*THREE))["relation.weight"] == (12, 3)


@pytest.mark.parametrize("relations", [THREE, ("NEAR", "ABOVE")])
def test_initial_weights_of_what_they_share_are_drawn_first(relations: tuple[str, ...]) -> None:
    """So that a seed says the same of detectors and layers whatever relations there are."""
    several = initial_actor(network(*relations), np.random.default_rng(0))
    alone = initial_actor(
        network("ABOVE"), np.random.default_rng(0)
    )  # with the hand's pose as well
    names = list(several)
    for name in names[: names.index("relation.weight")]:
        np.testing.assert_array_equal(several[name], alone[name])
