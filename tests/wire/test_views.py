"""Measured poses, and markers around what a program is about."""

from __future__ import annotations

import numpy as np
import pytest
from visualization_msgs.msg import Marker, MarkerArray

from helpers.rejections import rejected
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.views import decode_pose, encode_outlines, encode_pose

POSE = np.array([0.1, -2.0, 0.3, 0.5, -0.5, 0.5, 0.5])


def test_a_pose_survives_the_wire_and_gets_a_unit_quaternion():
    message = encode_pose(POSE * (1, 1, 1, 1.05, 1.05, 1.05, 1.05), "world", 1_500_000_000)
    assert header_stamp(message) == 1_500_000_000
    frame, pose = decode_pose(message)
    assert frame == "world"
    np.testing.assert_allclose(pose, POSE)


@pytest.mark.parametrize("index", [0, 6])
@pytest.mark.parametrize(("value", "code"), [(np.nan, "wire.non_finite"), (1e5, "wire.range")])
def test_impossible_poses_are_rejected(index, value, code):
    pose = POSE.copy()
    pose[index] = value
    with rejected(code):
        decode_pose(encode_pose(pose, "world", 0))


def test_an_empty_pose_is_rejected():
    with rejected("wire.range", match=r"pose.orientation.*length 1.*0\.0"):
        decode_pose(encode_pose(np.zeros(7), "world", 0))


@pytest.mark.parametrize("number", [-1, 2, 2**31 - 1])
def test_a_marker_that_is_no_block_gets_no_outline(number):
    markers = MarkerArray(markers=[Marker(ns="blocks", id=n) for n in (number, 1)])
    outlined = encode_outlines(markers, [1.0, 0.5])
    assert [marker.color.a for marker in outlined.markers] == [0.0, 0.25]
