"""Φ by NumPy is the reference's, and p of it what a program means."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pa_ros.acting.actor import Actor
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.language import parse
from pa_ros.learning.checkpoints import load_policy
from pa_ros.networks.detectors import degrees
from pa_ros.networks.inference import TorchActor
from pa_ros.networks.parameters import TensorError
from pa_ros.world.labels import labels


@pytest.fixture(scope="module")
def scene():
    task = ReachTask(preset_named("fast"), design_named("3-D"), 2)
    return task.reset(0)[0], load_policy(Path("shipped:3-D"))


def test_degrees_are_those_of_the_torch_reference(scene):
    observation, policy = scene
    network = Actor.of(policy).network
    seen = observation.objects, network.world.arm(observation)
    expected = TorchActor(network, policy.tensors).properties(*seen)
    assert np.allclose(degrees(network, policy.tensors, *seen), expected, atol=1e-5)
    with pytest.raises(TensorError, match="expected columns of 34 features, got 37"):
        degrees(network, policy.tensors, seen[0], np.zeros(21, np.float32))


def test_p_tells_the_block_that_is_meant(scene):
    observation, policy = scene
    program = parse("NEAR(HAND, AND(RED, CUBE))", design_named("3-D").vocabulary)
    actor = Actor.fitting(policy)
    assert actor.relevance(observation, program) == ()  # no weights yet
    actor.load(policy)
    names = labels(observation.objects, observation.hand_index)
    p = dict(zip(names, actor.relevance(observation, program), strict=True))
    assert p["hand"] == pytest.approx(1.0) and p["RED CUBE"] > 0.8
    assert all(degree < 0.2 for name, degree in p.items() if name not in ("hand", "RED CUBE"))
