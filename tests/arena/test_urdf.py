"""The forward kinematics of the URDF, computed independently, agree with the model."""

from xml.etree import ElementTree as ET

import numpy as np
import pytest

from pa_ros.arena import ARMS, ReachTask, design_named, preset_named
from pa_ros.arena.rearranging import bodies
from pa_ros.arena.urdf import urdf


def turn(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.split()])


def hand(description: str, positions: dict[str, float]) -> np.ndarray:
    """The hand's pose [4, 4] at these joint positions, as URDF defines it."""
    joints = {j.find("child").get("link"): j for j in ET.fromstring(description).iter("joint")}
    link, pose = "hand", np.eye(4)
    while link != "world":
        joint = joints[link]
        origin, step = joint.find("origin"), np.eye(4)
        roll, pitch, yaw = numbers(origin.get("rpy"))
        step[:3, :3] = turn("z", yaw) @ turn("y", pitch) @ turn("x", roll)
        step[:3, 3] = numbers(origin.get("xyz"))
        if joint.get("type") != "fixed":
            assert np.allclose(numbers(joint.find("axis").get("xyz")), [0, 0, 1])
            step[:3, :3] = step[:3, :3] @ turn("z", positions[joint.get("name")])
        pose, link = step @ pose, joint.find("parent").get("link")
    return pose


@pytest.mark.parametrize("arm", list(ARMS))
def test_the_urdf_puts_the_hand_where_the_model_has_it(arm):
    config = preset_named("fast", arm)
    task = ReachTask(config, design_named("2-L"), 0)
    task.reset(0)
    description = urdf(task.simulation.model, arm, config.joint_speed_limits)
    robot = ET.fromstring(description)
    assert all(link.find("visual") is not None for link in robot.iter("link"))
    assert not list(robot.iter("box")), "the table is not part of the arm"
    names = [j.get("name") for j in robot.iter("joint")]
    assert names[:-1] == list(ARMS[arm].joint_names) and names[-1] == "hand_fixed"
    rng = np.random.default_rng(0)
    for _ in range(20):
        observation, _ = task.step(rng.uniform(-1, 1, config.joints))
        positions = dict(zip(ARMS[arm].joint_names, observation.joint_position, strict=True))
        pose, body = hand(description, positions), bodies(task)[0]
        assert pose[:3, 3] == pytest.approx(body.position, abs=1e-6)
        x, y, z, w = body.quaternion
        forward = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
        assert pose[:3, 2] == pytest.approx(forward, abs=1e-6)
