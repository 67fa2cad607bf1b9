"""Measured poses, and markers around what a program is about."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from visualization_msgs.msg import Marker, MarkerArray

from helpers.rejections import rejected
from pa_ros.wire.fields import write_vector
from pa_ros.wire.robot import decode_tracked
from pa_ros.wire.views import encode_outlines

POSE = np.array([0.1, -2.0, 0.3, 0.5, -0.5, 0.5, 0.5])


def posed(numbers: np.ndarray) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = "world"
    write_vector(message.pose.position, numbers[:3])
    write_vector(message.pose.orientation, numbers[3:], "xyzw")
    return message


def test_a_measured_pose_gets_a_unit_quaternion():
    frame, _, pose, _ = decode_tracked(posed(POSE * (1, 1, 1, 1.05, 1.05, 1.05, 1.05)), "cup")
    assert frame == "world"
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
