"""The torch networks against the formulas as they stand: forward and gradients, both dtypes."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from helpers import formulas
from pa_ros.language import Vocabulary, parse
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.inference import TorchActor
from pa_ros.networks.parameters import initial_actor, initial_critic
from pa_ros.networks.programmable import ProgrammableActor, ProgrammableCritic, Programs
from pa_ros.networks.relevance import program_tensors
from pa_ros.world.programs import ProgramTable
from pa_ros.world.schema import COLORS, PAPER, SHAPES
from pa_ros.world.world import World

WORDS = Vocabulary.of(
    shape=("CUBE", "SPHERE", "CYLINDER", "C"), color=("RED", "GREEN", "BLUE", "A", "B")
)
WORLD = World(PAPER, WORDS, joints=6)
TEXTS = (
    "NEAR(HAND, AND(RED, CUBE))",
    "NEAR(HAND, GREEN)",
    "NEAR(HAND, OR(AND(BLUE, SPHERE), NOT(OR(RED, A, C)), CYLINDER))",
    "NEAR(HAND, NOT(NOT(AND(NOT(B), CUBE, GREEN))))",
)
KINDS = ("programmable", "distilled-critic", "true-properties")


def random_objects(rng: np.random.Generator, batch: int, n: int) -> np.ndarray:
    """Ω of scenes with the hand first: [B, N, 16]."""
    objects = np.zeros((batch, n, 16))
    objects[..., :3] = rng.normal(0, 0.3, (batch, n, 3))
    rotation = rng.normal(size=(batch, n, 4))
    objects[..., 3:7] = rotation / np.linalg.norm(rotation, axis=-1, keepdims=True)
    shape = rng.integers(len(SHAPES), size=(batch, n))
    color = rng.integers(len(COLORS), size=(batch, n))
    objects[..., 7:] = np.concatenate([np.eye(4)[shape], np.eye(5)[color]], -1)
    objects[:, 0, :3], objects[:, 0, 7:] = 0.0, 0.0
    return objects


def network(kind: str = "programmable", self_weight: float = 1.0) -> NetworkConfig:
    return NetworkConfig(
        world=WORLD,
        family=kind,
        hidden=12,
        attention=7,
        actor_output_scale=0.5,
        self_weight=self_weight,
    )


def tensors_of(config: NetworkConfig, seed: int = 0) -> tuple[dict, dict]:
    """Weights larger than the initial ones, so that nothing is nearly linear or uniform."""
    rng = np.random.default_rng(seed)
    actor, critic = initial_actor(config, rng), initial_critic(config, rng)
    for tensors in (actor, critic):
        for tensor in tensors.values():
            tensor *= 2.0
    return actor, critic


def module(kind: type, config: NetworkConfig, tensors: dict, dtype: torch.dtype):
    made = kind(config).to(dtype)
    made.load_state_dict({name: torch.from_numpy(value) for name, value in tensors.items()})
    return made


def programs(rows: np.ndarray) -> Programs:
    table = ProgramTable(WORDS)
    for text in TEXTS:
        table.add(parse(text, WORDS))
    return Programs(*(tensor[torch.from_numpy(rows)] for tensor in program_tensors(table)))


def scenes(objects, arm, rows, hand_index: int) -> formulas.Scenes:
    features, joints = (torch.from_numpy(array).double() for array in (objects, arm))
    programs = [parse(text, WORDS) for text in TEXTS]
    return formulas.Scenes(features, joints, programs, torch.from_numpy(rows), hand_index)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("self_weight", [1.0, 0.3, 0.0])
@pytest.mark.parametrize(("n", "k", "hand_index"), [(5, 1, 0), (2, 3, 1), (7, 4, 3), (1, 2, 0)])
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-11), (torch.float32, 1e-5)])
def test_agree_with_the_formulas(kind, self_weight, n, k, hand_index, dtype, tolerance) -> None:
    rng = np.random.default_rng(n)
    config = network(kind, self_weight)
    actor_tensors, critic_tensors = tensors_of(config)
    objects = random_objects(rng, 3, n).astype(np.float32).astype(np.float64)
    arm = rng.normal(size=(3, 18)).astype(np.float32).astype(np.float64)
    actions = rng.uniform(-1, 1, (3, k, 6)).astype(np.float32).astype(np.float64)
    rows = rng.integers(len(TEXTS), size=(3, k))
    weigh = rng.normal(size=(3, k, 6))
    given = [torch.from_numpy(array).to(dtype) for array in (objects, arm, actions, weigh)]
    actor = module(ProgrammableActor, config, actor_tensors, dtype)
    critic = module(ProgrammableCritic, config, critic_tensors, dtype)
    a = actor(given[0], given[1], programs(rows), hand_index)
    q = critic(given[0], given[1], programs(rows), given[2], hand_index)
    (a * given[3]).sum().backward()
    (q * given[3][..., 0]).sum().backward()

    actor_named, critic_named = map(formulas.parameters, (actor_tensors, critic_tensors))
    seen = scenes(objects, arm, rows, hand_index)
    expected_a = formulas.actor(config, actor_named, seen)
    expected_q = formulas.critic(config, critic_named, seen, torch.from_numpy(actions))
    (expected_a * torch.from_numpy(weigh)).sum().backward()
    (expected_q * torch.from_numpy(weigh[..., 0])).sum().backward()

    def close(ours: torch.Tensor, theirs: torch.Tensor) -> None:
        torch.testing.assert_close(ours.double(), theirs, rtol=tolerance, atol=tolerance)

    close(a.detach(), expected_a.detach())
    close(q.detach(), expected_q.detach())
    for made, named in ((actor, actor_named), (critic, critic_named)):
        for name, parameter in made.named_parameters():
            gradient = named[name].grad
            if gradient is None:  # one object hears nobody
                gradient = torch.zeros_like(named[name])
            scale = max(1.0, float(gradient.abs().max()))
            close(parameter.grad / scale, gradient / scale)


def test_an_action_per_scene_is_an_action_for_each_program() -> None:
    rng = np.random.default_rng(0)
    config = network()
    critic = module(ProgrammableCritic, config, tensors_of(config)[1], torch.float64)
    objects = torch.from_numpy(random_objects(rng, 2, 4))
    arm, action = torch.from_numpy(rng.normal(size=(2, 18))), torch.rand(2, 6).double()
    rows = np.array([[0, 1, 2], [3, 3, 0]])
    once = critic(objects, arm, programs(rows), action)
    each = critic(objects, arm, programs(rows), action[:, None].expand(-1, 3, -1))
    torch.testing.assert_close(once, each)


def test_irrelevant_objects_change_nothing() -> None:
    """p_j = 0 removes an object from α, from the messages and from h (paper, relational)."""
    config = network("true-properties")
    actor = module(ProgrammableActor, config, tensors_of(config)[0], torch.float64)
    rng = np.random.default_rng(2)
    objects = random_objects(rng, 1, 3)
    objects[0, 1:, 7:] = 0.0
    objects[0, 1, [7, 11]] = 1.0  # a red cube
    objects[0, 2, [8, 13]] = 1.0  # a blue sphere
    arm = torch.from_numpy(rng.normal(size=(1, 18)))
    moved = objects.copy()
    moved[0, 2, :3] += 10.0
    red_cube = programs(np.array([[0]]))
    before, after, without = (
        actor(torch.from_numpy(given), arm, red_cube) for given in (objects, moved, objects[:, :2])
    )
    torch.testing.assert_close(before, after)
    torch.testing.assert_close(before, without)


def test_inference_shows_its_properties() -> None:
    rng = np.random.default_rng(3)
    config = network()
    tensors = tensors_of(config)[0]
    objects = random_objects(rng, 1, 4).astype(np.float32)
    arm = rng.normal(size=18).astype(np.float32)
    phi = TorchActor(config, tensors).properties(objects[0], arm)
    seen = scenes(objects, arm[None], np.zeros((1, 1), int), 0)
    expected = formulas.properties(config, formulas.parameters(tensors), seen)
    for row, (word, degrees) in enumerate(expected.items()):
        assert WORDS.row[word] == row
        np.testing.assert_allclose(phi[row], degrees[0].detach(), atol=1e-5)
