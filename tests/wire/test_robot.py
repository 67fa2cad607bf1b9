"""What robots' sensors send is read or rejected with the field's name; markers for viewers."""

from collections import Counter
from typing import Any

import numpy as np
import pytest
from control_msgs.msg import JointJog
from geometry_msgs.msg import Pose, PoseStamped, Quaternion, TransformStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage
from vision_msgs.msg import Detection3D, Detection3DArray, ObjectHypothesisWithPose
from visualization_msgs.msg import Marker, MarkerArray

from helpers.rejections import rejected
from pa_ros.wire import WireError
from pa_ros.wire.fields import write_vector
from pa_ros.wire.robot import (
    LABEL_M,
    decode_detections,
    decode_driver_joints,
    decode_jog,
    decode_tracked,
    decode_transforms,
    encode_table,
)
from pa_ros.wire.views import SHELL, encode_outlines

HALF_TURN = [0.0, 0.0, 1.0, 0.0]
NAN = float("nan")
fail: Any = pytest.fail
WANTED = {"cup": "measured:cup", "ball": "measured:ball"}


def transform(**rotation: float) -> TransformStamped:
    message = TransformStamped(child_frame_id="tag36h11:3")
    message.header.frame_id, message.header.stamp.sec = "camera", 2
    message.header.stamp.nanosec = 3
    message.transform.translation.x = 0.5
    for name, value in rotation.items():
        setattr(message.transform.rotation, name, value)
    return message


def detection(kind: str, score: float, x: float, w: float = 1.0, box: float = 0.0) -> Detection3D:
    guess = ObjectHypothesisWithPose()
    guess.hypothesis.class_id, guess.hypothesis.score = kind, score
    guess.pose.pose.position.x, guess.pose.pose.orientation.w = x, w
    found = Detection3D(results=[guess])
    found.bbox.center.position.x = box
    return found


def transforms(*sent: TransformStamped, wanted: Any = None, refuse: Any = None) -> Any:
    payload = bytes(serialize_message(TFMessage(transforms=sent)))
    return decode_transforms(payload, wanted, refuse or fail)[0]


def detected(*sent: Detection3D, wanted: Any = WANTED, refuse: Any = None) -> Any:
    message = Detection3DArray(detections=sent)
    message.header.frame_id = "camera"
    return decode_detections(message, wanted, refuse or fail)


def test_a_transform_is_a_pose_of_its_child_in_its_parent():
    ((parent, child, pose, stamp),) = transforms(transform(z=1.02, w=0.0))
    assert (parent, child, stamp) == ("camera", "tag36h11:3", 2 * 10**9 + 3)
    assert pose.tolist() == [0.5, 0.0, 0.0, *HALF_TURN]


def link(parent: str, child: str, x: float = 0.0) -> TransformStamped:
    message = transform()
    message.header.frame_id, message.child_frame_id = parent, child
    message.transform.translation.x = x
    return message


@given(st.lists(st.tuples(st.text(min_size=1, max_size=9), st.text(max_size=9)), max_size=5))
def test_transforms_are_read_from_their_bytes_whatever_the_lengths_of_their_names(pairs):
    names = [pair for pair in pairs if not {"\0", "/"} & set("".join(pair))]
    sent = [link(parent, child, float(i)) for i, (parent, child) in enumerate(names)]
    last = {child: (parent, float(i)) for i, (parent, child) in enumerate(names)}
    assert {child: (parent, pose[0]) for parent, child, pose, _ in transforms(*sent)} == last


def test_a_frame_drops_the_slash_that_ros_1_put_before_it():
    ((parent, child, *_),) = transforms(link("/camera", "/cup"), wanted=["cup"])
    tracked = PoseStamped(pose=Pose(orientation=Quaternion(w=1.0)))
    tracked.header.frame_id = "/camera"
    assert (parent, child, decode_tracked(tracked, "dog")[0]) == ("camera", "cup", "camera")


def test_only_the_transforms_of_wanted_frames_and_of_those_above_them_are_read():
    sent = link("world", "base"), link("map", "dog", NAN), link("base", "hand"), link("base", "cup")
    measured = transforms(*sent, wanted=["hand", "nowhere"])
    assert [child for _, child, *_ in measured] == ["hand", "base"]


def test_a_transform_that_is_no_pose_costs_itself_alone():
    refused: list[WireError] = []
    sent = [
        transform(w=0.0),
        transform(x=NAN),
        link("", "c"),
        link("p", "d", 1e300),
        link("p", "e"),
    ]
    for name, one in zip("ab", sent, strict=False):
        one.child_frame_id = name
    assert [child for _, child, *_ in transforms(*sent, refuse=refused.append)] == ["e"]
    codes = {"wire.range": 2, "wire.non_finite": 1, "wire.frame": 1}
    assert Counter(error.code for error in refused) == codes


def test_bytes_that_are_no_transforms_are_rejected():
    payload = bytes(serialize_message(TFMessage(transforms=[transform()])))
    for end in range(4, len(payload)):
        with rejected("wire.truncated"):
            decode_transforms(payload[:end], None, fail)
    with rejected("wire.encoding"):
        decode_transforms(b"\0\0" + payload[2:], None, fail)


def test_of_each_wanted_class_the_detection_with_the_highest_score_counts():
    seen = ("cup", 0.2, NAN), ("cup", 0.9, 2.0), ("cup", NAN, 3.0), ("dog", 1.0, NAN)
    ((frame, name, pose, _),) = detected(*(detection(*one) for one in seen))
    assert (frame, name, pose[0]) == ("camera", "measured:cup", 2.0)
    assert detected(Detection3D()) == [], "no class"


@pytest.mark.parametrize(
    ("bad", "code"),
    [
        (detection("cup", 1.0, NAN), "wire.non_finite"),
        (detection("cup", 1.0, 1.0, w=0.0), "wire.range"),
        (detection("cup", NAN, 1.0), "wire.non_finite"),
        (detection("cup", 1.0, 0.0), "wire.range"),
    ],
)
def test_a_wanted_detection_that_is_no_pose_costs_itself_alone(bad, code):
    refused: list[WireError] = []
    sent = bad, detection("ball", 0.5, 1.0)
    assert [name for _, name, *_ in detected(*sent, refuse=refused.append)] == ["measured:ball"]
    assert [error.code for error in refused] == [code]


@pytest.mark.parametrize(
    ("result", "w", "box", "x"),
    [(1.0, 1.0, 0.0, 1.0), (1.0, 1.0, 2.0, 1.0), (0.0, 1.0, 2.0, 2.0), (0.0, 0.0, 2.0, 2.0)],
)
def test_the_pose_of_a_detection_is_in_its_result_or_if_that_is_empty_its_box(result, w, box, x):
    ((_, _, pose, _),) = detected(detection("cup", 1.0, result, w, box))
    assert pose[0] == x


def test_joints_are_found_by_name_among_others_whose_values_do_not_matter():
    message = JointState(name=["elbow", "thumb", "base", "thumb", "tip"])
    message.position, message.velocity = [1.0, NAN, 3.0, 1e300], [4.0, NAN, 6.0]
    position, velocity, _ = decode_driver_joints(message, ("base", "elbow"))
    assert position.tolist() == [3.0, 1.0] and velocity.tolist() == [6.0, 4.0]
    assert decode_driver_joints(message, ("wrist",)) is None, "of a gripper"


@pytest.mark.parametrize(
    ("velocity", "names", "code"),
    [
        ([], ["base", "elbow"], "wire.size"),
        ([1.0], ["base", "elbow"], "wire.size"),
        ([1.0, 2.0, 3.0], ["base", "elbow"], "wire.size"),
        ([1.0, NAN], ["base", "elbow"], "wire.non_finite"),
        ([1.0, 1e300], ["base", "elbow"], "wire.range"),
        ([1.0, 2.0, 3.0], ["base", "elbow", "base"], "wire.joint_names"),
    ],
)
def test_values_of_the_arms_joints_are_there_once_and_possible(velocity, names, code):
    message = JointState(name=names, position=[0.0] * len(names), velocity=velocity)
    with rejected(code, match="joint_states.* expected .* received") as caught:
        decode_driver_joints(message, ("elbow", "base"))
    assert ("does the driver publish them?" in str(caught.value)) == (not velocity)


def test_joints_that_a_jog_leaves_out_rest():
    jog = JointJog(joint_names=["tip", "base"], velocities=[0.3, -0.1])
    assert decode_jog(jog, ("base", "elbow", "tip")).tolist() == [-0.1, 0.0, 0.3]


@pytest.mark.parametrize(
    ("names", "velocities", "code"),
    [
        ([], [], "wire.size"),
        (["base"], [], "wire.size"),
        (["base"], [NAN], "wire.non_finite"),
        (["base", "thumb"], [0.1, 0.1], "wire.joint_names"),
        (["base", "base"], [0.1, 0.1], "wire.joint_names"),
    ],
)
def test_a_jog_that_is_no_motion_of_the_arm_is_rejected(names, velocities, code):
    with rejected(code, match="takeover_joints.* expected .* received"):
        decode_jog(JointJog(joint_names=names, velocities=velocities), ("base", "elbow"))


def test_markers_show_box_objects_and_where_the_hand_goes():
    pose, box = np.array([1.0, 0, 0, 0, 0, 0, 1.0]), ([0.5, 0, 0], [2.0, 2, 2])
    shown = encode_table("base", box, {"hand": pose}, np.array([0.4, 0, 0]), 5).markers
    by_name = {marker.ns: marker for marker in shown}
    room, label, arrow = (by_name[name] for name in ("workspace", "names", "motion"))
    assert (room.pose.position.x, room.pose.position.y, room.scale.x) == (1.25, 1.0, 1.5)
    assert (label.text, label.pose.position.x, label.scale.z) == ("hand", 1.0, LABEL_M)
    assert arrow.scale.y == 2 * arrow.scale.x > 0
    seen = [[c.r, c.g, c.b, c.a] for c in (room.color, label.color, arrow.color)]
    assert seen == [[0, 1, 0, pytest.approx(0.1)], [1, 1, 1, 1], [1, 0, 0, 1]]
    assert [point.x for point in by_name["motion"].points] == pytest.approx([1.0, 1.2])
    assert {m.header.frame_id for m in shown} == {"base"} and shown[0].action == Marker.DELETEALL


POSE = np.array([0.1, -2.0, 0.3, 0.5, -0.5, 0.5, 0.5])


def posed(numbers: np.ndarray, frame: str = "world") -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = frame
    write_vector(message.pose.position, numbers[:3])
    write_vector(message.pose.orientation, numbers[3:], "xyzw")
    return message


def test_a_measured_pose_gets_a_unit_quaternion_and_the_name_that_it_is_kept_under():
    sent = posed(POSE * (1, 1, 1, 1.05, 1.05, 1.05, 1.05))
    frame, name, pose, _ = decode_tracked(sent, "measured:cup")
    assert (frame, name) == ("world", "measured:cup")
    np.testing.assert_allclose(pose, POSE)


@pytest.mark.parametrize(
    ("index", "value", "code"),
    [(0, np.nan, "wire.non_finite"), (0, 1e5, "wire.range"), (slice(3, 7), 0.0, "wire.range")],
)
def test_impossible_poses_are_rejected(index, value, code):
    pose = POSE.copy()
    pose[index] = value
    with rejected(code):
        decode_tracked(posed(pose), "cup")
    with rejected("wire.frame"):
        decode_tracked(posed(POSE, ""), "cup")


def test_a_block_gets_the_p_of_the_object_that_is_seen_where_it_is():
    """Its number does not say which: a camera sees blocks in an order of its own."""
    places = np.array([[np.inf] * 3, [0.0, 0.01, 0.0], [0.49, 0.0, 0.0]])
    # The second time no camera sees a block.
    for seen, p, opacities in ((3, [1.0, 0.5, 0.0], [0.0, 0.25]), (1, [1.0], [0.0, 0.0])):
        markers = MarkerArray(markers=[Marker(ns="blocks", id=n) for n in (0, 2**31 - 1)])
        markers.markers[0].pose.position.x = markers.markers[0].scale.y = 0.5
        outlined = encode_outlines(markers, places[:seen], p)
        assert [marker.scale.y for marker in outlined.markers] == [0.5 * SHELL, 0.0]
        assert [marker.color.a for marker in outlined.markers] == opacities
    assert encode_outlines(MarkerArray(), places, [1.0, 0.5, 0.0]) is None
