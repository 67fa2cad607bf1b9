"""Layouts for RViz and Foxglove name topics, types and fields that the graph has.

Neither program is on the Python index: that they open the files is not tested.
"""

import json
import re
from importlib.resources import files

import pytest
import yaml
from sensor_msgs.msg import Image
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from pa_ros.ros import topics
from pa_ros.wire.simulator import WORLD

LAYOUTS = files("pa_ros") / "layouts"
TOPICS = {t.name.lstrip("/"): t for t in vars(topics).values() if isinstance(t, topics.Topic)}
SHOWS = {"RobotModel": String, "MarkerArray": MarkerArray, "Image": Image}  # RViz's displays
DURABILITIES = {"Volatile": "VOLATILE", "Transient Local": "TRANSIENT_LOCAL"}


@pytest.fixture
def rviz():
    return yaml.safe_load((LAYOUTS / "pa_ros.rviz").read_text())["Visualization Manager"]


@pytest.fixture
def foxglove():
    return json.loads((LAYOUTS / "pa_ros.foxglove.json").read_text())


def test_rviz_subscribes_to_topics_with_compatible_quality_of_service(rviz):
    shown = {}
    for display in rviz["Displays"]:
        heard = display.get("Topic") or display.get("Description Topic")
        if heard is None:
            continue
        topic = TOPICS[heard["Value"]]
        assert topic.type is SHOWS[display["Class"].rpartition("/")[2]]
        durability = DURABILITIES[heard["Durability Policy"]]
        assert durability in ("VOLATILE", topic.writer.durability.name)
        assert heard["Reliability Policy"].upper() == topic.writer.reliability.name
        shown[topic.name] = durability
    latched = shown.pop("robot_description")
    assert latched == "TRANSIENT_LOCAL"  # it is sent once
    assert set(shown) == {"markers", "camera/image_raw"}


def test_rviz_uses_the_frame_of_the_markers(rviz):
    assert rviz["Global Options"]["Fixed Frame"] == WORLD
    assert rviz["Views"]["Current"]["Target Frame"] == WORLD


def leaves(tree) -> list[str]:
    """Panels of a layout."""
    if isinstance(tree, str):
        return [tree]
    assert tree["direction"] in ("row", "column")
    return leaves(tree["first"]) + leaves(tree["second"])


def test_foxglove_places_each_configured_panel_once(foxglove):
    placed = leaves(foxglove["layout"])
    assert sorted(placed) == sorted(foxglove["configById"])


def test_foxglove_names_existing_topics_and_fields(foxglove):
    text = json.dumps(foxglove["configById"])
    paths = set(re.findall(r'"/([a-z_]+)((?:\.[a-z_]+)?)(?:\[:\])?"', text))
    assert {name for name, _ in paths} == {
        *("markers", "robot_description", "object_features", "joint_states"),
        *("program_status", "program", "diagnostics"),
    }
    for name, field in paths:
        fields = TOPICS[name].type.get_fields_and_field_types()
        assert not field or field[1:] in fields, f"{name}{field}"


def test_foxglove_publishes_a_program(foxglove):
    panel = foxglove["configById"]["Publish!program"]
    assert TOPICS[panel["topicName"].lstrip("/")] is topics.PROGRAM
    message = topics.PROGRAM.type(**json.loads(panel["value"]))
    assert message.text == "NEAR(HAND, AND(RED, CUBE))"
    assert panel["datatype"] == "msgs_schema/msg/Program"
