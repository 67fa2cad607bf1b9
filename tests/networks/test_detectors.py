"""Φ by NumPy is the reference's, and p of it what a program means."""

from pathlib import Path

import numpy as np
import pytest

from pa_ros.acting.executing import Actor
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.language import LOGICS, MIN_MAX, PRODUCT, parse
from pa_ros.learning.checkpoints import load_policy
from pa_ros.networks.detectors import degrees
from pa_ros.networks.torch_actor import TorchActor
from pa_ros.world.schema import PAPER, ObjectSchema, OneHot, PropertyGroup, Real


@pytest.fixture(scope="module")
def scene():
    task = ReachTask(preset_named("fast"), design_named("3-D"), 2)
    return task.reset(0)[0], load_policy(Path("shipped:3-D"))


@pytest.mark.parametrize("logic", LOGICS.values(), ids=LOGICS)
def test_degrees_are_those_of_the_torch_reference(scene, logic):
    observation, policy = scene
    network = Actor.of(policy).network
    seen = observation.objects, network.world.arm(observation)
    expected = TorchActor(network, policy.tensors, logic).properties(*seen)
    assert np.allclose(degrees(network, policy.tensors, *seen, logic), expected, atol=1e-5)


def test_executing_is_surer_of_what_is_known_and_no_surer_of_what_is_not(scene):
    observation, policy = scene
    network = Actor.of(policy).network
    arm, objects = network.world.arm(observation), observation.objects
    by_products, sharp = (
        degrees(network, policy.tensors, objects, arm, logic) for logic in (PRODUCT, MIN_MAX)
    )
    true = network.world.truth(objects).T == 1
    assert (sharp[true] > by_products[true]).all() and sharp[true].min() >= 0.97
    bare = objects.copy()
    bare[:, network.world.schema.properties] = 0.0  # blocks that show nothing
    found = degrees(network, policy.tensors, bare, arm, MIN_MAX)
    row = network.vocabulary.row
    for words in (("CUBE", "SPHERE", "CYLINDER"), ("RED", "GREEN", "BLUE")):  # of training
        said = found[[row[word] for word in words]]
        assert np.ptp(said, axis=0).max() < 0.05 and said.max() < 0.35


def test_p_tells_the_block_that_is_meant(scene):
    observation, policy = scene
    program = parse("NEAR(HAND, AND(RED, CUBE))", design_named("3-D").vocabulary)
    actor = Actor.fitting(policy)
    assert actor.relevance(observation, program) == ()  # no weights yet
    actor.load(policy)
    names = PAPER.labels(observation.objects, observation.hand_index)
    p = dict(zip(names, actor.relevance(observation, program), strict=True))
    assert p["hand"] == pytest.approx(1.0) and p["RED CUBE"] > 0.8
    assert all(degree < 0.2 for name, degree in p.items() if name not in ("hand", "RED CUBE"))


def test_words_of_objects_are_those_that_are_true_of_them() -> None:
    """Also of groups with a `_` in their name, and of those that are numbers."""
    size = PropertyGroup("size", ("LARGE",), Real(("m",), {"LARGE": (0.08,)}, 0.01))
    kind = PropertyGroup("kind_of_thing", ("MUG", "TEA_POT"), OneHot(("MUG", "TEA_POT")))
    schema = ObjectSchema((kind, size))
    row = schema.features({"kind_of_thing": "TEA_POT", "size": "LARGE"})
    objects = np.stack([np.zeros_like(row), row, np.zeros_like(row)])
    assert schema.labels(objects, 0) == ("hand", "LARGE TEA_POT", "block 2")
