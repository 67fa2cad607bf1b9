"""Networks are shown one of the objects to be avoided at a time, and none that is far away."""

from dataclasses import replace

import numpy as np
import pytest

from pa_ros.acting.executing import AVOIDED_WITHIN_M, EQUAL_M, NEARNESS_M, Actor
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.core.experience import PolicySnapshot
from pa_ros.language import Program, satisfying
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import initial_actor


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
                total, expected = (
                    total + weight,
                    expected + weight * actor.infer(only, program),
                )
            found = actor.act(replace(observation, objects=objects), program)
            np.testing.assert_allclose(found, expected / total, atol=1e-6)
    assert {0, most} <= counts
