"""robot.yaml: what it says is read; each wrong value is one clear error."""

import math

import pytest
import yaml

from helpers.robots import KINDS, robot_values
from pa_ros.core.errors import ConfigError
from sim_node.robot.settings import load_robot, pose_of, read_robot

CUBE = {"words": ["RED", "CUBE"], "frame": "tag36h11:3"}
JOINTS = robot_values()["joints"]


def test_a_file_says_what_measures_each_object(tmp_path):
    objects = {
        "by_tag": {**CUBE, "offset": [0, 0, -0.03]},
        "by_class": {"words": ["GREEN", "CUBE"], "detection": "cup"},
        "by_topic": {"words": ["SPHERE", "RED"], "topic": "poses/ball"},
    }
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump(robot_values(objects=objects), sort_keys=False))
    robot = load_robot(path)
    frames = [thing.source for thing in robot.objects.values()]
    assert frames == ["tag36h11:3", "measured:cup", "measured:poses/ball"]
    assert pose_of(robot.objects["by_tag"].offset).tolist() == [0, 0, -0.03, 0, 0, 0, 1]
    assert robot.kinds == KINDS[:3] and robot.settings.dry_run


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"joints": JOINTS[:5]}, "joints: expected a list of 6 for jaco, got"),
        (
            {"joints": [*JOINTS[:5], {"name": "j", "sign": 0}]},
            "joints[5]: sign: expected one of [1, -1]",
        ),
        ({"joints": [*JOINTS[:5], {"nam": "j"}]}, "joints[5]: nam"),
        ({"joints": [*JOINTS[:5], JOINTS[0]]}, "joints[5].name: expected a name of its own, got"),
        (
            {"joints": [{"name": ""}, *JOINTS[1:]]},
            "joints[0].name: expected a name of its own, got ''",
        ),
        ({"joints": [{"name": "j", "offset": 1e300}, *JOINTS[1:]]}, "joints[0]: offset: expected"),
        ({"base_frame": ""}, "base_frame: expected a name of its own, got ''"),
        ({"base_frame": "hand"}, "hand_frame: expected a name of its own, got 'hand', as base_f"),
        ({"objects": {"hand": CUBE}}, "objects.hand: expected another name"),
        (
            {"objects": {"a": CUBE, "b": {**CUBE, "words": ["RED", "SPHERE"]}}},
            "objects.b: expected",
        ),
        (
            {"objects": {"a": {**CUBE, "frame": "world"}}},
            "objects.a: expected a name of its own, got",
        ),
        ({"objects": {"a": {**CUBE, "offset": [math.nan, 0, 0]}}}, "objects.a: offset: expected"),
        ({"hand_offset": [0, 0, 1e300]}, "hand_offset: expected numbers of at most 100"),
        ({"objects": {}}, "objects: expected names with their settings"),
        ({"objects": {"a": {"words": ["RED", "CUBE"]}}}, "objects.a: expected exactly one of"),
        ({"objects": {"a": {**CUBE, "topic": "f"}}}, "objects.a: expected exactly one of"),
        ({"objects": {"a": {**CUBE, "words": ["RED"]}}}, "objects.a.words: expected one word of"),
        ({"objects": {"a": {**CUBE, "words": ["RED", "RED"]}}}, "objects.a.words: expected one"),
        ({"objects": {"a": {**CUBE, "offset": [1, 2]}}}, "objects.a: offset: expected x y z"),
        ({"hand_offset": [0, 0, 0, 0, 0, 0, 2]}, "hand_offset: expected a quaternion of length 1"),
        ({"workspace": {"lower": [0, 0, 1], "upper": [1, 1, 1]}}, "workspace.lower: expected less"),
        ({"workspace": {"lower": [0, 0], "upper": [1, 1, 1]}}, "workspace.lower: expected"),
        ({"speed_scale": 2.0}, "speed_scale: expected a number in (0, 1], got 2.0"),
        ({"control": "torque"}, "control: expected one of ['velocity'"),
        ({"base_frame": 3}, "base_frame: expected text, got 3"),
        ({"speed_scal": 1.0}, "speed_scal: unknown setting; did you mean 'speed_scale'?"),
    ],
)
def test_a_wrong_value_is_one_line_with_its_name(changes, expected):
    with pytest.raises(ConfigError) as error:
        read_robot(robot_values(**changes))
    assert str(error.value).startswith(expected) and "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["base_frame", "hand_frame", "workspace", "joints", "objects"])
def test_what_must_be_said_has_no_default(name):
    values = robot_values()
    del values[name]
    with pytest.raises(ConfigError, match=f"^{name}: expected"):
        read_robot(values)


@pytest.mark.parametrize("text", ["a: [", "just words", "", "\x00"])
def test_a_file_that_is_no_mapping_is_named(tmp_path, text):
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match="robot.yaml: expected"):
        load_robot(path)
    with pytest.raises(ConfigError, match="nowhere: expected a file robot.yaml, got"):
        load_robot(tmp_path / "nowhere")


def test_quaternions_get_length_1():
    assert pose_of((0, 0, 0, 0, 0, 0, 1.05)).tolist() == [0, 0, 0, 0, 0, 0, 1]
