"""Object features against an independent computation."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pa_ros.arena import ReachTask, design_named, preset_named, scripted_action
from pa_ros.world.schema import COLORS, PAPER, SHAPES

NAMES = PAPER.feature_names


@pytest.fixture
def task() -> ReachTask:
    return ReachTask(preset_named("paper"), design_named("3-C"), seed=5)


def test_one_hots_are_the_properties_of_the_blocks(task: ReachTask) -> None:
    observation, _ = task.reset(1)
    names = [name.split("_")[-1].upper() for name in NAMES]
    for row, block in zip(observation.objects[1:], task.episode.blocks, strict=True):
        assert {names[i] for i in np.flatnonzero(row[7:]) + 7} == block.kind.words
        assert sorted(row[7:])[-2:] == [1.0, 1.0] and row[7:].sum() == 2.0
    assert NAMES[7] == f"shape_{SHAPES[0].lower()}"
    assert NAMES[11] == f"color_{COLORS[0].lower()}"


def test_poses_are_in_the_frame_of_the_hand(task: ReachTask) -> None:
    rng = np.random.default_rng(0)
    for episode in range(5):
        observation, _ = task.reset(episode)
        for _ in range(40):
            model, simulated = task.simulation.model, task.simulation.data
            hand = simulated.body("hand")
            frame = Rotation.from_quat(hand.xquat, scalar_first=True)
            for i, row in enumerate(observation.objects[1:]):
                body = simulated.body(f"block{i}")
                place = frame.inv().apply(body.xpos - hand.xpos)
                np.testing.assert_allclose(row[:3], place, atol=1e-6)
                relative = frame.inv() * Rotation.from_quat(body.xquat, scalar_first=True)
                turn = Rotation.from_quat(row[3:7])
                np.testing.assert_allclose(turn.as_matrix(), relative.as_matrix(), atol=1e-6)
                assert row[6] >= 0
                assert np.linalg.norm(row[3:7]) == pytest.approx(1, abs=1e-6)
            pose, turned = observation.hand_pose, Rotation.from_quat(observation.hand_pose[3:])
            np.testing.assert_allclose(pose[:3], hand.xpos, atol=1e-12)
            np.testing.assert_allclose(turned.as_matrix(), frame.as_matrix(), atol=1e-12)
            assert pose[6] >= 0
            assert model.nq == 6 + 7 * 4
            command = rng.uniform(-1, 1, 6) * np.array(task.config.joint_speed_limits)
            observation, _ = task.step(command)


def test_poses_belong_to_the_joint_positions_of_the_same_step(task: ReachTask) -> None:
    """MuJoCo leaves poses one physics step behind the joints without another mj_kinematics."""
    import mujoco

    task.reset(0)
    observation, _ = task.step(np.array(task.config.joint_speed_limits))
    before = observation.objects.copy()
    mujoco.mj_forward(task.simulation.model, task.simulation.data)
    np.testing.assert_array_equal(before, task.simulation.objects())
    np.testing.assert_array_equal(observation.joint_position, task.simulation.data.qpos[:6])


def test_observations_share_no_arrays_with_the_simulation(task: ReachTask) -> None:
    observation, _ = task.reset(0)
    kept = [a.copy() for a in (observation.objects, observation.joint_position)]
    for _ in range(5):
        task.step(scripted_action(task))
    for array, copy in zip((observation.objects, observation.joint_position), kept, strict=True):
        np.testing.assert_array_equal(array, copy)
        assert np.asarray(array).base is None
