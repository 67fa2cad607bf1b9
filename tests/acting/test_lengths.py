"""The lengths of executing follow from where NEAR begins in the world at hand."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.worlds import WORLD
from pa_ros.acting.executing import AVOIDED_WITHIN_M, Actor
from pa_ros.core.experience import Observation, PolicySnapshot
from pa_ros.language import parse
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import initial_actor

PROGRAM = "AVOID(BLUE, NEAR(HAND, RED))"


def seen_at(metres: float) -> Observation:
    """The hand with the red cube 1 m away and the blue sphere at a distance."""
    objects = np.zeros((3, WORLD.object_features), np.float32)
    objects[:, 6] = 1.0
    objects[1, 0], objects[2, 1] = 1.0, metres
    columns = [WORLD.schema.features({"shape": s, "color": c})
               for s, c in (("CUBE", "RED"), ("SPHERE", "BLUE"))]  # fmt: skip
    objects[1:, 7:] = [row[7:] for row in columns]
    joints, pose = np.zeros(WORLD.joints), np.array([0.0, 0, 0, 0, 0, 0, 1])
    return Observation(0, 0, 0, objects, joints, joints, 0, "", pose)


@pytest.mark.parametrize("threshold", [0.07, 0.20, 0.35])
def test_what_is_avoided_is_heeded_within_twice_the_distance_of_near(threshold: float) -> None:
    own = () if threshold == 0.20 else (threshold,)
    world = replace(WORLD, vocabulary=WORLD.vocabulary.avoiding(), thresholds=own)
    network = NetworkConfig(world=world, hidden=8, attention=4)
    tensors = initial_actor(network, np.random.default_rng(0))
    tensors["output.weight"] *= 100  # so that actions differ
    weight = tensors["detectors.weight"]
    weight[:] = 0.0
    for row, word in enumerate(world.vocabulary.words):  # each word is known
        names = list(world.schema.feature_names)
        column = [i for i, name in enumerate(names) if name.endswith(f"_{word.lower()}")]
        weight[row, column] = 8.0
    snapshot = PolicySnapshot(0, network.architecture, world.digest, tensors)
    actor, program = Actor.of(snapshot), parse(PROGRAM, world.vocabulary)
    border = AVOIDED_WITHIN_M * threshold / 0.20
    for metres, heeds in ((border * 0.99, True), (border * 1.01, False)):
        observation = seen_at(metres)
        alone = replace(observation, objects=observation.objects[:2])
        without = actor.act(alone, program.relation_alone)
        assert np.allclose(actor.act(observation, program), without, atol=1e-6) != heeds
