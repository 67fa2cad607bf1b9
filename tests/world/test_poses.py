"""Object features from measured poses."""

import numpy as np
import pytest

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.arena.rearranging import bodies
from pa_ros.world.poses import objects_from_poses
from pa_ros.world.schema import PAPER


def measured(task):
    """Poses [1 + n, 7] and labels of an arena's hand and blocks."""
    poses = [np.concatenate([body.position, body.quaternion]) for body in bodies(task)]
    return np.array(poses), [block.kind for block in task.episode.blocks]


@pytest.mark.parametrize("seed", range(3))
def test_features_from_poses_equal_the_arenas(seed):
    task = ReachTask(preset_named("fast"), design_named("3-D"), seed=seed)
    task.reset(0)
    rng = np.random.default_rng(seed)
    for _ in range(20):
        observation, _ = task.step(rng.uniform(-1, 1, 6))
    poses, labels = measured(task)
    found = objects_from_poses(PAPER, labels, poses)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, observation.objects, atol=1e-6)
