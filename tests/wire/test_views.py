"""Measured poses on the wire."""

import numpy as np
import pytest

from helpers.rejections import rejected
from pa_ros.wire.errors import WireError
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.views import decode_pose, encode_pose

POSE = np.array([0.1, -2.0, 0.3, 0.5, -0.5, 0.5, 0.5])


def test_a_pose_comes_back():
    message = encode_pose(POSE, "world", 1_500_000_000)
    assert header_stamp(message) == 1_500_000_000
    frame, pose = decode_pose(message)
    assert frame == "world"
    np.testing.assert_array_equal(pose, POSE)


def test_an_orientation_is_made_a_unit_quaternion():
    scaled = POSE * (1, 1, 1, 1.05, 1.05, 1.05, 1.05)
    _, pose = decode_pose(encode_pose(scaled, "", 0))
    np.testing.assert_allclose(pose, POSE)


@pytest.mark.parametrize("index", range(7))
@pytest.mark.parametrize(("value", "error"), [(np.nan, "wire.non_finite"), (1e5, "wire.range")])
def test_what_no_tracker_means_is_refused(index, value, error):
    pose = POSE.copy()
    pose[index] = value
    with rejected(error):
        decode_pose(encode_pose(pose, "world", 0))


def test_a_message_that_nobody_filled_in_is_refused():
    with pytest.raises(WireError, match=r"pose.orientation.*length 1.*0\.0"):
        decode_pose(encode_pose(np.zeros(7), "world", 0))
