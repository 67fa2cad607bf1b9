"""What robots' sensors send is read or rejected with the field's name; markers for viewers."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TransformStamped
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage
from vision_msgs.msg import Detection3D, Detection3DArray, ObjectHypothesisWithPose
from visualization_msgs.msg import Marker, MarkerArray

from helpers.rejections import rejected
from pa_ros.wire.fields import write_vector
from pa_ros.wire.robot import (
    decode_detections,
    decode_driver_joints,
    decode_tracked,
    decode_transforms,
    encode_table,
)
from pa_ros.wire.views import encode_outlines

HALF_TURN = [0.0, 0.0, 1.0, 0.0]


def transform(**rotation: float) -> TransformStamped:
    message = TransformStamped(child_frame_id="tag36h11:3")
    message.header.frame_id, message.header.stamp.sec = "camera", 2
    message.transform.translation.x = 0.5
    for name, value in rotation.items():
        setattr(message.transform.rotation, name, value)
    return message


def detection(kind: str, score: float, x: float, w: float = 1.0) -> Detection3D:
    found = ObjectHypothesisWithPose()
    found.hypothesis.class_id, found.hypothesis.score = kind, score
    found.pose.pose.position.x, found.pose.pose.orientation.w = x, w
    return Detection3D(results=[found])


def test_a_transform_is_a_pose_of_its_child_in_its_parent():
    both = TFMessage(transforms=[transform(z=1.02, w=0.0), transform()])
    parent, child, pose, stamp = decode_transforms(both)[0]
    assert (parent, child, stamp) == ("camera", "tag36h11:3", 2 * 10**9)
    assert pose.tolist() == [0.5, 0.0, 0.0, *HALF_TURN]
    with rejected("wire.range"):
        decode_transforms(TFMessage(transforms=[transform(w=0.0)]))
    with rejected("wire.non_finite"):
        decode_transforms(TFMessage(transforms=[transform(x=float("nan"))]))


def test_of_each_wanted_class_the_detection_with_the_highest_score_counts():
    message = Detection3DArray()
    message.header.frame_id = "camera"
    seen = ("cup", 0.2, 1.0), ("cup", 0.9, 2.0), ("cup", 0.5, 3.0), ("dog", 1.0, 4.0)
    message.detections = [detection(*one) for one in seen]
    ((frame, name, pose, _),) = decode_detections(message, {"cup": "measured:cup"})
    assert (frame, name, pose[0]) == ("camera", "measured:cup", 2.0)
    message.detections = [detection("cup", 1.0, 0.0, w=0.0)]
    with rejected("wire.range"):
        decode_detections(message, {"cup": "x"})


def test_joints_are_found_by_name_among_others():
    message = JointState(name=["elbow", "thumb", "base"], position=[1.0, 2.0, 3.0])
    message.velocity = [4.0, 5.0, 6.0]
    position, velocity, _ = decode_driver_joints(message, ("base", "elbow"))
    assert position.tolist() == [3.0, 1.0] and velocity.tolist() == [6.0, 4.0]
    assert decode_driver_joints(message, ("wrist",)) is None, "of a gripper"
    message.velocity = []
    with rejected("wire.size"):
        decode_driver_joints(message, ("base",))


def test_markers_show_box_objects_and_where_the_hand_goes():
    pose, box = np.array([1.0, 0, 0, 0, 0, 0, 1.0]), ([0.0, 0, 0], [2.0, 2, 2])
    shown = encode_table("base", box, {"hand": pose}, np.array([0.4, 0, 0]), 5).markers
    by_name = {marker.ns: marker for marker in shown}
    assert by_name["workspace"].pose.position.y == 1.0 and by_name["workspace"].scale.x == 2.0
    assert [point.x for point in by_name["motion"].points] == pytest.approx([1.0, 1.2])
    assert {m.header.frame_id for m in shown} == {"base"} and shown[0].action == Marker.DELETEALL


POSE = np.array([0.1, -2.0, 0.3, 0.5, -0.5, 0.5, 0.5])


def posed(numbers: np.ndarray) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = "world"
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


def test_a_block_gets_the_p_of_the_object_that_is_seen_where_it_is():
    """Its number does not say which: a camera sees blocks in an order of its own."""
    places = np.array([[np.inf] * 3, [0.0, 0.01, 0.0], [0.49, 0.0, 0.0]])
    # The second time no camera sees a block.
    for seen, p, opacities in ((3, [1.0, 0.5, 0.0], [0.0, 0.25]), (1, [1.0], [0.0, 0.0])):
        markers = MarkerArray(markers=[Marker(ns="blocks", id=n) for n in (0, 2**31 - 1)])
        markers.markers[0].pose.position.x = 0.5
        outlined = encode_outlines(markers, places[:seen], p)
        assert [marker.color.a for marker in outlined.markers] == opacities
    assert encode_outlines(MarkerArray(), places, [1.0, 0.5, 0.0]) is None
