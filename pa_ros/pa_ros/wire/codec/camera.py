"""What a camera sees, and how it sees."""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float64
from pa_ros.wire.codec.stamp import write_stamp
from pa_ros.wire.interfaces import CameraInfo, Image


def encode_image(picture: NDArray[np.uint8], frame: str, stamp_ns: int) -> Image:
    """`picture` [height, width, 3] RGB, seen from the optical frame of that name."""
    height, width, channels = picture.shape
    message = Image(height=height, width=width, encoding="rgb8", step=channels * width)
    message.header.frame_id = frame
    write_stamp(message.header.stamp, stamp_ns)
    message.data = array("B", picture.tobytes())
    return message


def encode_camera_info(
    matrix: Float64, width: int, height: int, frame: str, stamp_ns: int
) -> CameraInfo:
    """K [3, 3] px of a camera without distortion, which sees what is in front of `frame`."""
    message = CameraInfo(height=height, width=width, distortion_model="plumb_bob", d=[0.0] * 5)
    message.header.frame_id = frame
    write_stamp(message.header.stamp, stamp_ns)
    message.k, message.r = matrix.ravel(), np.eye(3).ravel()
    message.p = np.hstack([matrix, np.zeros((3, 1))]).ravel()
    return message
