"""Finds AprilTags in the camera's pictures and publishes them to tf, as apriltag_ros does
(docs/robot.md). Needs the extra `tags`."""

import mujoco
import numpy as np
import pupil_apriltags
from rclpy.node import Node

from pa_ros.core.experience import Body
from pa_ros.ros import topics
from pa_ros.ros.node_main import run_node
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.views import encode_transforms

FAMILY, TAG_M = "tag36h11", 0.05  # edge of the black square


def finder() -> pupil_apriltags.Detector:
    return pupil_apriltags.Detector(families=FAMILY, quad_decimate=1.0)


def find(
    detector, picture: np.ndarray, matrix: np.ndarray, tag_m: float = TAG_M
) -> dict[int, Body]:
    """The tags in a picture [height, width, 3], each with its pose in the optical frame.

    As in apriltag_ros, a tag's x points right, y up, and z out of the tag.
    """
    grey = np.ascontiguousarray(picture.mean(-1).astype(np.uint8))
    camera = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    found = {}
    for tag in detector.detect(grey, estimate_tag_pose=True, camera_params=camera, tag_size=tag_m):
        turned, quaternion = tag.pose_R @ np.diag([1.0, -1.0, -1.0]), np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, turned.ravel())
        found[tag.tag_id] = Body.at_rest(tag.pose_t.ravel(), np.roll(quaternion, -1))
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
