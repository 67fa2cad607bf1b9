"""Object features from measured poses."""

import numpy as np
import pytest

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.arena.rearranging import bodies
from pa_ros.core.errors import ConfigError
from pa_ros.world.poses import objects_from_poses, times
from pa_ros.world.schema import PAPER


def measured(task):
    """Poses [1 + n, 7] and labels of an arena's hand and blocks."""
    poses = [np.concatenate([body.position, body.quaternion]) for body in bodies(task)]
    return np.array(poses), [block.kind for block in task.episode.blocks]


@pytest.mark.parametrize("seed", range(5))
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


def test_features_do_not_depend_on_the_frame_of_the_poses():
    task = ReachTask(preset_named("fast"), design_named("3-D"), seed=1)
    task.reset(0)
    poses, labels = measured(task)
    turn = np.array([0.1, -0.5, 0.3, 0.8])
    turn /= np.linalg.norm(turn)
    back = turn * (-1, -1, -1, 1)
    elsewhere = poses.copy()
    place = np.concatenate([poses[:, :3], np.zeros((len(poses), 1))], 1)
    elsewhere[:, :3] = times(times(turn, place), back)[:, :3] + (1.0, 2.0, -3.0)
    elsewhere[:, 3:] = times(turn, poses[:, 3:])
    np.testing.assert_allclose(
        objects_from_poses(PAPER, labels, elsewhere),
        objects_from_poses(PAPER, labels, poses),
        atol=1e-6,
    )


def test_unknown_labels_are_rejected():
    poses = np.array([[0, 0, 0, 0, 0, 0, 1]] * 2, float)
    with pytest.raises(ConfigError, match="shape.*expected.*CUBE.*'CONE'"):
        objects_from_poses(PAPER, [{"shape": "CONE", "color": "RED"}], poses)
