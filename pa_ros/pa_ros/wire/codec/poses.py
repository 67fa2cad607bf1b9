"""Poses that somebody measures."""

from __future__ import annotations

import numpy as np

from pa_ros.core.experience import Float64
from pa_ros.wire import errors
from pa_ros.wire.arrays import read_float64
from pa_ros.wire.codec.simulator import write_vector
from pa_ros.wire.codec.stamp import write_stamp
from pa_ros.wire.codec.step import LARGEST
from pa_ros.wire.interfaces import PoseStamped

UNIT = 0.9, 1.1  # length of what passes for a unit quaternion


def encode_pose(pose: Float64, frame: str, stamp_ns: int) -> PoseStamped:
    """`pose` [7]: position, m, and quaternion xyzw."""
    message = PoseStamped()
    message.header.frame_id = frame
    write_stamp(message.header.stamp, stamp_ns)
    write_vector(message.pose.position, pose[:3])
    write_vector(message.pose.orientation, pose[3:], "xyzw")
    return message


def decode_pose(message: PoseStamped) -> tuple[str, Float64]:
    """In which frame, and [7]: position (m), unit quaternion xyzw.

    Raises NonFiniteError, RangeError.
    """
    place, turn = message.pose.position, message.pose.orientation
    numbers = [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]
    pose = read_float64("pose", numbers, (7,), LARGEST)
    length = float(np.linalg.norm(pose[3:]))
    if not UNIT[0] <= length <= UNIT[1]:
        raise errors.RangeError("pose.orientation", "a quaternion of length 1", f"length {length}")
    pose[3:] /= length
    return str(message.header.frame_id), pose
