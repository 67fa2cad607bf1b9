"""The actor: noise, weights it refuses, the order an agent must keep, and how it avoids a set."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from helpers.worlds import PROGRAMS, WORLD, PointWorld, dpg
from pa_ros.acting.errors import ActingError
from pa_ros.acting.executing import AVOIDED_WITHIN_M, EQUAL_M, NEARNESS_M, Actor
from pa_ros.acting.exploration import ExplorationNoise
from pa_ros.acting.policy import inference_for
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.core.experience import PolicySnapshot
from pa_ros.language import MIN_MAX, PRODUCT, Program, ProgramError, Vocabulary, parse, satisfying
from pa_ros.learning.learner import Learner
from pa_ros.native.engine import FusedActor
from pa_ros.networks.config import NetworkConfig, actor_config
from pa_ros.networks.parameters import initial_actor
from pa_ros.networks.torch_actor import TorchActor

NETWORK = NetworkConfig(world=WORLD, hidden=6, attention=4)
SETTINGS = dpg(replay__capacity_frames=100, schedule__trajectory_steps=20)


def snapshot(network: NetworkConfig = NETWORK):
    return Learner(network, SETTINGS, PROGRAMS, seed=0).snapshot()


def test_exploring_adds_the_episodes_noise_to_what_the_networks_say() -> None:
    noise = SETTINGS.exploration, 0.1, 5, 6
    actor = Actor(NETWORK, noise=ExplorationNoise(*noise))
    actor.load(snapshot())
    world = PointWorld()
    same = ExplorationNoise(*noise)
    for episode in (0, 4):
        observation, _ = world.reset(episode)
        for _ in range(5):
            said = actor.infer(observation, world.program)
            expected = np.clip(said + same.sample(episode), -1, 1).astype(np.float32)
            action = actor.explore(observation, world.program)
            np.testing.assert_array_equal(action, expected)
            assert action.dtype == np.float32
            observation, _ = world.step(action.astype(np.float64))


def test_what_noise_takes_beyond_the_bounds_is_clipped() -> None:
    noise = SETTINGS.exploration.changed(sigma=5.0)
    actor = Actor(NETWORK, noise=ExplorationNoise(noise, 0.1, 5, 6))
    actor.load(snapshot())
    world = PointWorld()
    observation, _ = world.reset(0)
    action = actor.explore(observation, world.program)
    assert (np.abs(action) <= 1).all() and {-1.0, 1.0} <= set(action.tolist())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"architecture": NetworkConfig(world=WORLD).architecture}, "expected architecture"),
        ({"world_digest": "0" * 16}, "expected world"),
        ({"tensors": {}}, "version 0: actor: tensors missing"),
    ],
)
def test_weights_that_do_not_fit_are_refused_and_change_nothing(change, message) -> None:
    actor = Actor(NETWORK)
    good = snapshot()
    actor.load(good)
    observation, _ = PointWorld().reset(0)
    before = actor.act(observation, PROGRAMS[0])
    with pytest.raises(ActingError, match=message):
        actor.load(replace(good, **change))
    assert actor.version == 0
    np.testing.assert_array_equal(actor.act(observation, PROGRAMS[0]), before)


@pytest.mark.parametrize("inference", ["auto", "torch"])
@pytest.mark.parametrize("kind", ["programmable", "canonical"])
@pytest.mark.parametrize("logic", [MIN_MAX, PRODUCT])
def test_newer_weights_act_as_they_do_in_an_actor_of_their_own(inference, kind, logic) -> None:
    network = NETWORK.changed(family=kind)
    older, newer = (Learner(network, SETTINGS, PROGRAMS, seed).snapshot() for seed in (0, 1))
    observation, _ = PointWorld().reset(0)
    actions = []
    for given in ([older], [older, newer], [newer]):
        actor = Actor(network, inference, logic=logic)
        for weights in given:
            actor.load(weights)
        actions.append(actor.act(observation, PROGRAMS[0]))
    np.testing.assert_array_equal(actions[1], actions[2])
    assert not np.array_equal(actions[0], actions[2])


def test_acts_by_the_fused_code_where_it_applies(caplog) -> None:
    inference_for.cache_clear()
    with caplog.at_level(logging.INFO):
        one, other = (Actor(NETWORK) for _ in range(2))
    assert [record.message for record in caplog.records] == ["actor inference: fused"]
    assert inference_for(NETWORK, "auto") is FusedActor
    assert (one.backend, Actor(NETWORK, "torch").backend) == ("fused", "torch")
    given = snapshot()
    one.load(given)
    observation, _ = PointWorld().reset(0)
    plain = TorchActor(NETWORK, given.tensors, MIN_MAX)
    expected = plain.act(observation.objects, WORLD.arm(observation), PROGRAMS[0], 0)
    other.load(given)
    acted, again = (each.act(observation, PROGRAMS[0]) for each in (one, other))
    np.testing.assert_allclose(acted, expected, rtol=0, atol=2e-6)
    np.testing.assert_array_equal(again, acted)


def test_the_graph_and_the_loop_choose_alike() -> None:
    """An agent on the graph knows the network by its architecture alone."""
    for kind in ("programmable", "distilled-critic", "true-properties", "canonical"):
        network = NETWORK.changed(family=kind)
        there = actor_config(network.architecture)
        assert inference_for(network, "auto") is inference_for(there, "auto")


def test_other_refusals() -> None:
    actor = Actor(NETWORK)
    observation, _ = PointWorld().reset(0)
    with pytest.raises(ActingError, match="got none"):
        actor.act(observation, PROGRAMS[0])
    assert actor.relevance(observation, PROGRAMS[0]) == ()
    actor.load(snapshot())
    unknown = parse("NEAR(HAND, GREEN)", Vocabulary.of(shape=("CUBE",), color=("GREEN",)))
    with pytest.raises(ProgramError):
        actor.act(observation, unknown)
    with pytest.raises(ActingError, match="greedy actor"):
        actor.explore(observation, PROGRAMS[0])
    with pytest.raises(ActingError, match="architecture"):
        Actor.of(replace(snapshot(), architecture="{}"))


@pytest.mark.parametrize(("condition", "most"), [("avoid", 1), ("avoid-or", 2), ("avoid-not", 3)])
def test_each_near_object_of_a_set_is_avoided(condition: str, most: int) -> None:
    task = ReachTask(preset_named("fast"), design_named("3-D-avoid"), seed=1)
    network = NetworkConfig(world=task.world, family="true-properties", hidden=8, attention=4)
    tensors = initial_actor(network, np.random.default_rng(0))
    tensors["output.weight"] = np.ones_like(tensors["output.weight"])
    actor = Actor(network)
    actor.load(PolicySnapshot(1, network.architecture, network.world.digest, tensors))
    counts = set()
    for index in range(4):
        observation, _ = task.reset(index, condition)
        program = task.program
        assert program.avoided is not None
        words = [frozenset[str](), *(block.kind.words for block in task.episode.blocks)]
        avoided = np.array(satisfying(Program(program.avoided), words, 0))
        assert avoided.sum() == most
        for scale in (1.0, 0.2, 5.0):
            objects = observation.objects.copy()
            objects[:, :3] *= scale
            distance = np.linalg.norm(objects[:, :3], axis=1)
            near = np.flatnonzero(avoided & (distance < AVOIDED_WITHIN_M))
            counts.add(len(near))
            left = replace(observation, objects=objects[~avoided])
            total = np.exp(-EQUAL_M / NEARNESS_M)
            expected = total * actor.act(left, program.relation_alone)
            for i in near:
                shown = ~avoided
                shown[i] = True
                weight = np.exp(-distance[i] / NEARNESS_M)
                only = replace(observation, objects=objects[shown])
                total += weight
                expected += weight * actor.infer(only, program)
            found = actor.act(replace(observation, objects=objects), program)
            np.testing.assert_allclose(found, expected / total, atol=1e-6)
    assert {0, most} <= counts
