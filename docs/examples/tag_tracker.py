"""Finds AprilTags in the camera's pictures and publishes them to tf, as apriltag_ros does
(docs/robot.md). Needs the extra `camera`."""

import cv2
import mujoco
import numpy as np
from rclpy.node import Node

from pa_ros.core.experience import Body
from pa_ros.ros import topics
from pa_ros.ros.node_main import run_node
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.views import encode_transforms

FAMILY, TAG_M = "tag36h11", 0.05  # edge of the black square
DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
CORNERS = [(-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)]  # of the black square, in half edges


def finder() -> cv2.aruco.ArucoDetector:
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return cv2.aruco.ArucoDetector(DICTIONARY, settings)


def find(
    detector, picture: np.ndarray, matrix: np.ndarray, tag_m: float = TAG_M
) -> dict[int, Body]:
    """The tags in a picture [height, width, 3], each with its pose in the optical frame.

    As in apriltag_ros, a tag's x points right, y up, and z out of the tag.
    """
    corners, numbers, _ = detector.detectMarkers(picture.mean(-1).astype(np.uint8))
    edges, found = np.array(CORNERS) * tag_m / 2, {}
    for square, number in zip(corners, [] if numbers is None else numbers.ravel(), strict=True):
        upright = np.roll(square[0], 2, 0)  # OpenCV's tags are AprilTag's turned by half a turn
        _, turn, place = cv2.solvePnP(edges, upright, matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, cv2.Rodrigues(turn)[0].ravel())
        found[int(number)] = Body.at_rest(place.ravel(), np.roll(quaternion, -1))
    return found


class TagTracker(Node):
    def __init__(self) -> None:
        super().__init__("tag_tracker")
        self.tag_m = self.declare_parameter("tag_m", TAG_M).value
        self.detector, self.matrix = finder(), None
        self.tf = topics.TF.publisher(self)
        topics.CAMERA_INFO.subscribe(self, self.on_info)
        topics.CAMERA_IMAGE.subscribe(self, self.on_picture)

    def on_info(self, message) -> None:
        self.matrix = message.k.reshape(3, 3)

    def on_picture(self, message) -> None:
        if self.matrix is None or message.encoding not in ("rgb8", "bgr8"):
            return
        shape = message.height, message.width, 3
        picture = np.frombuffer(message.data, np.uint8).reshape(shape)
        tags = find(self.detector, picture, self.matrix, self.tag_m)
        placed = {f"{FAMILY}:{number}": body for number, body in tags.items()}
        found = encode_transforms(placed, header_stamp(message))
        for transform in found.transforms:
            transform.header.frame_id = message.header.frame_id
        self.tf.publish(found)

    def close(self) -> None:
        pass


if __name__ == "__main__":
    raise SystemExit(run_node("tag_tracker", TagTracker))
