"""Descriptions of networks: refused values, canonical text, and what the text distinguishes."""

import json
from typing import Any

import numpy as np
import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.language import Vocabulary
from pa_ros.networks.config import NetworkConfig, actor_config
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.families import FAMILIES
from pa_ros.networks.parameters import (
    actor_shapes,
    check_tensors,
    critic_shapes,
    initial_actor,
    initial_critic,
)
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World

WORDS = Vocabulary.of(shape=("CUBE", "SPHERE", "C"), color=("BLUE", "A"))
WORLD = World(PAPER, WORDS, joints=6)


@pytest.mark.parametrize("kind", tuple(FAMILIES))
def test_json_round_trip(kind) -> None:
    config = NetworkConfig(world=WORLD, family=kind, hidden=7, critic_starts_unrewarded=True)
    assert NetworkConfig.from_json(config.to_json()) == config
    again = actor_config(config.architecture)
    assert again.architecture == config.architecture
    assert actor_shapes(again) == actor_shapes(config)


@pytest.mark.parametrize(("bias", "unrewarded"), [(-20.0, True), (0.0, False)])
def test_an_older_description_has_the_value_at_which_the_critic_starts(bias, unrewarded) -> None:
    values = json.loads(NetworkConfig(world=WORLD).to_json()) | {"critic_output_bias": bias}
    del values["critic_starts_unrewarded"]
    older = NetworkConfig.from_json(json.dumps(values))
    assert older == NetworkConfig(world=WORLD, critic_starts_unrewarded=unrewarded)


def test_architecture_tells_actors_apart_and_nothing_else() -> None:
    config = NetworkConfig(world=WORLD)
    other_words = Vocabulary.of(shape=("SPHERE", "CUBE", "C"), color=("BLUE", "A"))
    for same in ({"family": "distilled-critic"}, {"critic_starts_unrewarded": True}):
        assert config.changed(**same).architecture == config.architecture
    others: list[dict[str, Any]] = [
        {"hidden": 151},
        {"attention": 65},
        {"upper_layers": 1},
        {"position_scale": 1.0},
        {"family": "canonical"},
        {"family": "true-properties"},
        {"world": World(PAPER, WORDS, joints=7)},
        {"world": World(PAPER, other_words, joints=6)},
    ]
    told = {config.architecture, *(config.changed(**other).architecture for other in others)}
    assert len(told) == 1 + len(others)


@pytest.mark.parametrize("text", ["", "[1]", '{"shapes":["CUBE"],"colors":["RED"]}'])
def test_text_that_describes_no_actor_is_refused(text) -> None:
    with pytest.raises(ConfigError):
        actor_config(text)
    values = json.loads(NetworkConfig(world=WORLD).architecture) | {"layers": 3}
    with pytest.raises(ConfigError, match="layers"):
        actor_config(json.dumps(values))


def test_shapes_are_those_of_the_design_notes() -> None:
    shapes = actor_shapes(NetworkConfig(world=WORLD))
    assert shapes["detectors.weight"] == (5, 34)
    assert shapes["query.weight"] == shapes["context.weight"] == (64, 34)
    assert shapes["attention.weight"] == (64,)
    assert shapes["local.0.weight"] == (150, 34) and shapes["local.1.weight"] == (150, 150)
    assert shapes["message.0.weight"] == (150, 68) and shapes["message.1.weight"] == (150, 150)
    assert shapes["output.weight"] == (6, 150)
    critic = critic_shapes(NetworkConfig(world=WORLD, family="distilled-critic"))
    assert "detectors.weight" not in critic
    assert critic["action.weight"] == (150, 6) and critic["output.weight"] == (1, 150)


def test_initial_weights() -> None:
    config = NetworkConfig(world=WORLD)
    rng = np.random.default_rng(5)
    actor, critic = initial_actor(config, rng), initial_critic(config, rng, -100.0)
    assert critic["output.bias"] == [-100.0]
    assert 2e-3 < np.abs(actor["output.weight"]).max() <= 3e-3
    assert 0.11 < np.abs(actor["message.0.weight"]).max() <= 68**-0.5
    assert 0.11 < np.abs(actor["message.0.bias"]).max() <= 68**-0.5
    again = initial_actor(config, np.random.default_rng(5))
    assert all(np.array_equal(actor[name], again[name]) for name in actor)


def test_detectors_that_start_at_nothing() -> None:
    config = NetworkConfig(world=WORLD, detector_init_scale=0.0)
    for make in (initial_actor, initial_critic):
        tensors = make(config, np.random.default_rng(5))
        default = make(NetworkConfig(world=WORLD), np.random.default_rng(5))
        detectors = {name for name in tensors if name.startswith("detectors.")}
        assert len(detectors) == 2 and not any(tensors[name].any() for name in detectors)
        assert all(np.array_equal(tensors[k], default[k]) for k in tensors.keys() - detectors)


def test_detectors_that_do_not_see_the_arm() -> None:
    blind, features = NetworkConfig(world=WORLD, detectors_see_arm=False), WORLD.object_features
    for make in (initial_actor, initial_critic):
        tensors = make(blind, np.random.default_rng(5))
        default = make(NetworkConfig(world=WORLD), np.random.default_rng(5))
        weight, usual = tensors.pop("detectors.weight"), default.pop("detectors.weight")
        assert not weight[:, features:].any() and usual[:, features:].all()
        np.testing.assert_array_equal(weight[:, :features], usual[:, :features])
        assert all(np.array_equal(tensors[k], default[k]) for k in tensors)


def test_relations_that_do_not_see_properties() -> None:
    hidden = NetworkConfig(world=WORLD, relations_see_properties=False)
    for make in (initial_actor, initial_critic):
        tensors = make(hidden, np.random.default_rng(5))
        default = make(NetworkConfig(world=WORLD), np.random.default_rng(5))
        for name in ("query", "context", "local.0", "message.0"):
            columns = tensors[f"{name}.weight"].reshape(-1, 34)
            assert not columns[:, 7:16].any()
            other = default[f"{name}.weight"].reshape(-1, 34)
            assert np.array_equal(np.delete(columns, np.r_[7:16], 1),
                                  np.delete(other, np.r_[7:16], 1))  # fmt: skip
        assert np.array_equal(tensors["detectors.weight"], default["detectors.weight"])
    assert hidden.architecture == NetworkConfig(world=WORLD).architecture


@pytest.mark.parametrize(
    ("bias", "message"),
    [
        (np.zeros(8, np.float32), r"query.bias: expected \(64,\), got \(8,\)"),
        (np.full(64, np.nan, np.float32), "query.bias: expected finite numbers"),
        (np.zeros(64, np.int64), "query.bias: expected a float tensor, got int64"),
    ],
)
def test_tensors_that_do_not_fit_are_rejected(bias, message) -> None:
    config = NetworkConfig(world=WORLD)
    tensors = initial_actor(config, np.random.default_rng(5))
    with pytest.raises(NetworkError, match=message):
        check_tensors(tensors | {"query.bias": bias}, actor_shapes(config), "actor")
    with pytest.raises(NetworkError, match="missing .*query.bias"):
        del tensors["query.bias"]
        check_tensors(tensors, actor_shapes(config), "actor")
