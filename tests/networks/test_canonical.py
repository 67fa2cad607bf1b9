"""Canonical networks: the flattened input by hand, torch against NumPy, what is refused."""

import numpy as np
import pytest
import torch

from pa_ros.language import Vocabulary, parse
from pa_ros.networks.canonical import CanonicalActor, CanonicalCritic
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.families import canonical_inputs, slot_values, target_one_hots
from pa_ros.networks.parameters import actor_shapes, critic_shapes, initial_actor, initial_critic
from pa_ros.networks.torch_actor import TorchActor
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World

WORDS = Vocabulary.of(shape=("CUBE", "SPHERE", "C"), color=("RED", "BLUE"))
WORLD = World(PAPER, WORDS, joints=6)
CONFIG = NetworkConfig(world=WORLD, family="canonical", canonical_hidden=9)


def block(shape: str, color: str, x: float) -> np.ndarray:
    features = np.zeros(16, np.float32)
    features[[0, 6]] = x, 1.0
    features[7:] = PAPER.features({"shape": shape, "color": color})[7:]
    return features


def hand() -> np.ndarray:
    return np.array([0, 0, 0, 0, 0, 0, 1] + [0] * 9, np.float32)


def module(kind: type, tensors: dict):
    made = kind(CONFIG).double()
    made.load_state_dict({name: torch.from_numpy(value) for name, value in tensors.items()})
    return made


def test_each_block_has_its_place() -> None:
    """Slots: red cube, blue cube, red sphere, blue sphere; absent ones are zero."""
    shapes, colors = (group.features.values for group in PAPER)
    assert [(shapes[i], colors[j]) for i, j in slot_values(WORLD)] == [
        ("CUBE", "RED"), ("CUBE", "BLUE"), ("SPHERE", "RED"), ("SPHERE", "BLUE"),
    ]  # fmt: skip
    sphere, cube = block("SPHERE", "RED", 0.1), block("CUBE", "BLUE", 0.2)
    arm = np.arange(18, dtype=np.float32)
    target = target_one_hots(parse("NEAR(HAND, AND(RED, SPHERE))", WORDS), WORDS)
    np.testing.assert_array_equal(target, [0, 1, 0, 1, 0])
    scaled = np.array([5.0, 5.0, 5.0] + [1.0] * 13)
    empty = np.zeros(16)
    expected = [hand(), empty, cube * scaled, sphere * scaled, empty, arm, target]
    flatten = CanonicalActor(CONFIG).flatten.double()
    for order in ([hand(), sphere, cube], [hand(), cube, sphere]):
        given = (torch.from_numpy(np.stack(order))[None], torch.from_numpy(arm)[None])
        x = flatten(*(t.double() for t in given), torch.from_numpy(target)[None, None].double(), 0)
        assert x.shape == (1, 1, canonical_inputs(WORLD))
        np.testing.assert_allclose(x[0, 0].numpy(), np.concatenate(expected), rtol=1e-6)


def test_modules_and_inference_agree_with_the_layers_by_hand() -> None:
    rng = np.random.default_rng(0)
    actor, critic = initial_actor(CONFIG, rng), initial_critic(CONFIG, rng)
    objects = np.stack([block("SPHERE", "BLUE", 0.3), hand(), block("CUBE", "RED", -0.2)])
    arm = rng.normal(size=18).astype(np.float32)
    program = parse("NEAR(HAND, AND(CUBE, RED))", WORDS)
    target = target_one_hots(program, WORDS)
    given = [torch.from_numpy(x)[None].double() for x in (objects, arm, target[None])]
    actor_module = module(CanonicalActor, actor)
    x = actor_module.flatten(*given, 1)[0, 0].numpy()
    hidden = np.tanh(actor["layers.0.weight"] @ x + actor["layers.0.bias"])
    hidden = np.tanh(actor["layers.1.weight"] @ hidden + actor["layers.1.bias"])
    expected = np.tanh(actor["output.weight"] @ hidden + actor["output.bias"])
    action = actor_module(*given, 1)
    np.testing.assert_allclose(action[0, 0].detach().numpy(), expected, atol=1e-9)
    inferred = TorchActor(CONFIG, actor).act(objects, arm, program, 1)
    np.testing.assert_allclose(inferred, expected, atol=1e-5)

    hidden = np.tanh(critic["layers.0.weight"] @ x + critic["layers.0.bias"])
    hidden = np.concatenate([hidden, expected])
    hidden = np.tanh(critic["layers.1.weight"] @ hidden + critic["layers.1.bias"])
    q = module(CanonicalCritic, critic)(*given, action, 1)
    expected_q = critic["output.weight"] @ hidden + critic["output.bias"]
    np.testing.assert_allclose(q.detach().numpy(), expected_q[None], atol=1e-9)


def test_initial_weights_are_lillicraps() -> None:
    config = NetworkConfig(world=WORLD, family="canonical")
    rng = np.random.default_rng(0)
    for tensors, shapes in (
        (initial_actor(config, rng), actor_shapes(config)),
        (initial_critic(config, rng), critic_shapes(config)),
    ):
        for name, tensor in tensors.items():
            fan_in = shapes[name.replace("bias", "weight")][-1]
            bound = 3e-3 if name.startswith("output") else fan_in**-0.5
            assert np.abs(tensor).max() <= bound
            if name != "output.bias":
                assert np.abs(tensor).max() > 0.9 * bound


@pytest.mark.parametrize(
    "text",
    [
        "NEAR(HAND, RED)",
        "NEAR(HAND, AND(RED, BLUE))",
        "NEAR(HAND, OR(RED, CUBE))",
        "NEAR(HAND, AND(RED, NOT(CUBE)))",
    ],
)
def test_other_programs_are_refused(text) -> None:
    with pytest.raises(NetworkError, match="expected NEAR"):
        target_one_hots(parse(text, WORDS), WORDS)
