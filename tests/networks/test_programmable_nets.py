"""The torch networks against the formulas as they stand: forward and gradients, both dtypes."""

import numpy as np
import pytest
import torch

from helpers import formulas
from helpers.fused_settings import PROGRAMS, VOCABULARY, Setting, make_batch, setting
from pa_ros.language import parse
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.programmable import ProgrammableActor, ProgrammableCritic, Programs
from pa_ros.networks.relevance import program_tensors
from pa_ros.networks.torch_actor import TorchActor

KINDS = ("programmable", "distilled-critic", "true-properties")


def networks(kind: str = "programmable", self_weight: float = 1.0) -> Setting:
    """Weights larger than the initial ones, so that nothing is nearly linear or uniform."""
    made = setting(kind, hidden=12, attention=7, self_weight=self_weight)
    for tensor in (*made.actor.values(), *made.critic.values()):
        tensor *= 2.0
    return made


def random_objects(rng: np.random.Generator, batch: int, n: int) -> np.ndarray:
    """Ω of scenes with the hand first, [B, N, 16]."""
    return make_batch(rng, batch, n, 1, 1).objects.astype(np.float64)


def module(kind: type, config: NetworkConfig, tensors: dict, dtype: torch.dtype):
    made = kind(config).to(dtype)
    made.load_state_dict({name: torch.from_numpy(value) for name, value in tensors.items()})
    return made


def programs(rows: np.ndarray) -> Programs:
    table = setting().table
    return Programs(*(tensor[torch.from_numpy(rows)] for tensor in program_tensors(table)))


def scenes(objects, arm, rows, hand_index: int) -> formulas.Scenes:
    features, joints = (torch.from_numpy(array).double() for array in (objects, arm))
    programs = [parse(text, VOCABULARY) for text in PROGRAMS]
    return formulas.Scenes(features, joints, programs, torch.from_numpy(rows), hand_index)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("self_weight", [1.0, 0.3, 0.0])
@pytest.mark.parametrize(("n", "k", "hand_index"), [(5, 1, 0), (2, 3, 1), (7, 4, 3), (1, 2, 0)])
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-11), (torch.float32, 1e-5)])
def test_agree_with_the_formulas(kind, self_weight, n, k, hand_index, dtype, tolerance) -> None:
    rng = np.random.default_rng(n)
    made = networks(kind, self_weight)
    config, actor_tensors, critic_tensors = made.network, made.actor, made.critic
    objects = random_objects(rng, 3, n)
    arm = rng.normal(size=(3, 18)).astype(np.float32).astype(np.float64)
    actions = rng.uniform(-1, 1, (3, k, 6)).astype(np.float32).astype(np.float64)
    rows = rng.integers(len(PROGRAMS), size=(3, k))
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
    for network, named in ((actor, actor_named), (critic, critic_named)):
        for name, parameter in network.named_parameters():
            gradient = named[name].grad
            if gradient is None:  # one object hears nobody
                gradient = torch.zeros_like(named[name])
            scale = max(1.0, float(gradient.abs().max()))
            close(parameter.grad / scale, gradient / scale)


def test_an_action_per_scene_is_an_action_for_each_program() -> None:
    rng = np.random.default_rng(0)
    made = networks()
    critic = module(ProgrammableCritic, made.network, made.critic, torch.float64)
    objects = torch.from_numpy(random_objects(rng, 2, 4))
    arm, action = torch.from_numpy(rng.normal(size=(2, 18))), torch.rand(2, 6).double()
    rows = np.array([[0, 1, 2], [3, 3, 0]])
    once = critic(objects, arm, programs(rows), action)
    each = critic(objects, arm, programs(rows), action[:, None].expand(-1, 3, -1))
    torch.testing.assert_close(once, each)


def test_irrelevant_objects_change_nothing() -> None:
    """p_j = 0 removes an object from α, from the messages and from h (paper, relational)."""
    made = networks("true-properties")
    actor = module(ProgrammableActor, made.network, made.actor, torch.float64)
    rng = np.random.default_rng(2)
    objects = random_objects(rng, 1, 3)
    objects[0, 1:, 7:] = 0.0
    objects[0, 1, [7, 11]] = 1.0  # a red cube
    objects[0, 2, [8, 13]] = 1.0  # a blue sphere
    arm = torch.from_numpy(rng.normal(size=(1, 18)))
    moved = objects.copy()
    moved[0, 2, :3] += 10.0
    red_cube = programs(np.array([[1]]))
    before, after, without = (
        actor(torch.from_numpy(given), arm, red_cube) for given in (objects, moved, objects[:, :2])
    )
    torch.testing.assert_close(before, after)
    torch.testing.assert_close(before, without)


def test_inference_shows_its_properties() -> None:
    rng = np.random.default_rng(3)
    made = networks()
    config, tensors = made.network, made.actor
    objects = random_objects(rng, 1, 4).astype(np.float32)
    arm = rng.normal(size=18).astype(np.float32)
    phi = TorchActor(config, tensors).properties(objects[0], arm)
    seen = scenes(objects, arm[None], np.zeros((1, 1), int), 0)
    expected = formulas.properties(config, formulas.parameters(tensors), seen)
    for row, (word, degrees) in enumerate(expected.items()):
        assert VOCABULARY.row[word] == row
        np.testing.assert_allclose(phi[row], degrees[0].detach(), atol=1e-5)
