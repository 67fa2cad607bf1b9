"""The forward kinematics of the URDF, computed independently, agree with the model."""

from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest

from pa_ros.arena import ARMS, ReachTask, design_named, preset_named
from pa_ros.arena.rearranging import bodies
from pa_ros.arena.urdf import FRAMES, urdf


def turn(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.split()])


def pose_of(origin: ET.Element) -> np.ndarray:
    """The pose [4, 4] that an origin states."""
    (roll, pitch, yaw), pose = numbers(origin.get("rpy")), np.eye(4)
    pose[:3, :3] = turn("z", yaw) @ turn("y", pitch) @ turn("x", roll)
    pose[:3, 3] = numbers(origin.get("xyz"))
    return pose


def hand(description: str, positions: dict[str, float]) -> np.ndarray:
    """The hand's pose [4, 4] at these joint positions, as URDF defines it."""
    joints = {j.find("child").get("link"): j for j in ET.fromstring(description).iter("joint")}
    assert not joints.keys() & set(FRAMES), "tf has these, from another parent"
    link, pose = "hand_link", np.eye(4)
    while link != "world":
        joint = joints[link]
        step = pose_of(joint.find("origin"))
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
    assert names[:-1] == list(ARMS[arm].joint_names) and names[-1] == "hand_link_fixed"
    limits = [{name: float(text) for name, text in one.items()} for one in robot.iter("limit")]
    for i, (joint, limit) in enumerate(zip(ARMS[arm].joints, limits, strict=True)):
        ends = {"lower": joint.lower, "upper": joint.upper} if i or joint.limits else {}
        speed = config.joint_speed_limits[i]
        assert limit == pytest.approx({"velocity": speed, "effort": 0.0, **ends})
    assert numbers(next(robot.iter("color")).get("rgba")) == pytest.approx([0.8, 0.82, 0.86, 1.0])
    base = robot.find("link[@name='world']/visual")
    height = float(base.find("geometry/cylinder").get("length"))
    assert pose_of(base.find("origin"))[2, 3] == pytest.approx(height / 2), "it stands on the table"
    rng = np.random.default_rng(0)
    for _ in range(20):
        observation, _ = task.step(rng.uniform(-1, 1, config.joints))
        positions = dict(zip(ARMS[arm].joint_names, observation.joint_position, strict=True))
        pose, body = hand(description, positions), bodies(task)[0]
        assert pose[:3, 3] == pytest.approx(body.position, abs=1e-6)
        x, y, z, w = body.quaternion
        forward = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
        assert pose[:3, 2] == pytest.approx(forward, abs=1e-6)


TURNED = """<mujoco><worldbody><body name="link" quat="{quat}"><joint name="turn"/>
<geom type="{shape}" size="0.03 0.2" pos="0 0.1 0" quat="{quat}"/>
<body name="hand" quat="{quat}"><geom size="0.05"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("shape", "rounded"), [("cylinder", []), ("capsule", [-0.2, 0.2])])
def test_shapes_and_links_are_turned_as_in_the_model(shape, rounded):
    for quat in np.random.default_rng(0).normal(size=(10, 4)):
        text = TURNED.format(shape=shape, quat=" ".join(map(str, quat)))
        model = mujoco.MjModel.from_xml_string(text)
        simulated = mujoco.MjData(model)
        mujoco.mj_kinematics(model, simulated)
        description = urdf(model, "arm", [1.0])
        found = hand(description, {"turn": 0.0})[:3, :3].ravel()
        assert found == pytest.approx(simulated.body("hand").xmat, abs=1e-6)
        cylinder, *ends = ET.fromstring(description).iterfind("link[@name='link']/visual")
        assert cylinder.find("geometry/cylinder").attrib == {"radius": "0.03", "length": "0.4"}
        pose = pose_of(cylinder.find("origin"))
        # The link is turned as its geom, and starts where the world does.
        assert pose[:3, :3].ravel() == pytest.approx(simulated.body("link").xmat, abs=1e-6)
        for end, along in zip(ends, rounded, strict=True):
            assert end.find("geometry/sphere").get("radius") == "0.03"
            place = pose_of(end.find("origin"))[:3, 3]
            assert place == pytest.approx([0, 0.1, 0] + along * pose[:3, 2], abs=1e-6)
