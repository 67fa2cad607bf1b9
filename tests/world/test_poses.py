"""Object features from measured poses, and velocities that change no faster than allowed."""

import numpy as np
import pytest

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.arena.rearranging import bodies
from pa_ros.world.poses import objects_from_poses
from pa_ros.world.schema import PAPER
from pa_ros.world.velocity import DeadReckoning, VelocityRamp


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


def test_a_ramp_is_no_steeper_than_allowed_and_ends_at_the_limits():
    ramp, speeds = VelocityRamp((1.0, 2.0, 0.5), acceleration=2.0), []
    for _ in range(12):
        speeds.append(ramp.towards(np.array([1.0, -1.0, 0.1], np.float32), 0.1))
    steps = np.diff([np.zeros(3), *speeds], axis=0)
    assert np.abs(steps).max() <= 0.2 + 1e-9 and ramp.moving
    assert speeds[0] == pytest.approx([0.1, -0.2, 0.005]), "all get there together"
    assert speeds[-1] == pytest.approx([1.0, -2.0, 0.05])
    for _ in range(11):
        ramp.towards(np.zeros(3, np.float32), 0.1)
    assert not ramp.moving


def test_without_a_limit_it_follows_at_once():
    ramp = VelocityRamp((1.5,) * 7, acceleration=0.0)
    assert ramp.towards(np.full(7, -1.0, np.float32), 0.1) == pytest.approx([-1.5] * 7)


def test_an_arm_is_believed_where_its_commands_have_moved_it_since_the_last_measurement():
    arm = DeadReckoning((1.0, 1.0), lasts_s=0.25)
    arm.measured(np.array([0.5, -3.0]), 0.1, 10.0)
    assert arm.position == pytest.approx([0.5, -3.0]), "at rest"
    arm.sent(np.array([1.0, -0.2]), 10.0)
    arm.move(10.1)
    assert arm.position == pytest.approx([0.6, -3.02])
    arm.move(12.0)
    assert arm.position == pytest.approx([0.75, -3.05]), "the command lasts 0.25 s"
    arm.sent(np.array([1.0, 0.0]), 12.0)
    arm.measured(np.array([0.75, -3.05]), 0.1, 12.1)
    assert arm.position == pytest.approx([0.85, -3.05]), "moved on since the measurement"
    arm.measured(np.array([0.9, -3.05]), 0.2, 12.35)
    assert arm.position == pytest.approx([1.0, -3.05]), "until the command ended"
    arm.sent(np.array([-1.0, 0.0]), 12.4)
    arm.measured(np.array([1.0, -3.05]), 0.2, 12.45)
    assert arm.position == pytest.approx([0.95, -3.05]), "it began to turn back 0.05 s ago"
    arm.sent(np.zeros(2), 12.5)
    assert arm.position == pytest.approx([0.9, -3.05])


def test_a_wrong_measurement_moves_a_commanded_arm_no_faster_than_its_joints_turn():
    arm = DeadReckoning((1.0,), lasts_s=0.25)
    arm.measured(np.array([0.0]), 0.0, 10.0)
    for k in range(1, 4):
        arm.sent(np.zeros(1), 10.0 + k / 10)
    arm.measured(np.array([0.9]), 0.0, 10.4)
    assert arm.position == pytest.approx([0.4])
    arm.measured(np.array([0.5 - 4 * np.pi]), 0.0, 10.5)
    assert arm.position == pytest.approx([0.5 - 4 * np.pi]), "whole turns are no motion"
    arm.measured(np.array([2.0]), 0.0, 20.0)
    assert arm.position == pytest.approx([2.0]), "nobody commanded it: a hand has moved it"
