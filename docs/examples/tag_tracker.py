"""Finds AprilTags in the camera's pictures and publishes them to tf, as apriltag_ros does
(docs/robot.md). Needs the extra `camera`."""

from collections.abc import Sequence

import cv2
import mujoco
import numpy as np
from rclpy.node import Node

from pa_ros.core.experience import Body
from pa_ros.ros import topics
from pa_ros.ros.node_main import run_node
from pa_ros.ros.refusals import Refusals
from pa_ros.wire import WireError
from pa_ros.wire.views import decode_camera_info, decode_image, encode_transforms

FAMILY, TAG_M = "tag36h11", 0.05  # edge of the black square
DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
CORNERS = [(-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)]  # of the black square, in half edges


def finder() -> cv2.aruco.ArucoDetector:
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return cv2.aruco.ArucoDetector(DICTIONARY, settings)


def find(
    detector,
    picture: np.ndarray,
    matrix: np.ndarray,
    tag_m: float = TAG_M,
    model: str = "plumb_bob",
    distortion: Sequence[float] = (),
) -> dict[int, Body]:
    """The tags in a picture [height, width, 3], each with its pose in the optical frame.

    As in apriltag_ros, a tag's x points right, y up, and z out of the tag. `model` and `distortion`
    of the lens are as in CameraInfo.
    """
    corners, numbers, _ = detector.detectMarkers(picture.mean(-1).astype(np.uint8))
    edges, found = np.array(CORNERS) * tag_m / 2, {}
    for square, number in zip(corners, [] if numbers is None else numbers.ravel(), strict=True):
        upright = np.roll(square[0], 2, 0)  # OpenCV's tags are AprilTag's turned by half a turn
        rays = undistorted(upright, matrix, model, distortion)
        _, turn, place = cv2.solvePnP(edges, rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, cv2.Rodrigues(turn)[0].ravel())
        found[int(number)] = Body.at_rest(place.ravel(), np.roll(quaternion, -1))
    return found


def undistorted(corners, matrix, model, distortion) -> np.ndarray:
    """Where the rays of pixels [4, 2] meet the plane at a distance of 1."""
    pixels, lens = corners[:, None].astype(np.float64), np.array(distortion, np.float64)
    if model == "equidistant":
        return cv2.fisheye.undistortPoints(pixels, matrix, lens)
    return cv2.undistortPoints(pixels, matrix, lens)


class TagTracker(Node):
    def __init__(self) -> None:
        super().__init__("tag_tracker")
        self.tag_m = self.declare_parameter("tag_m", TAG_M).value
        self.detector, self.lens = finder(), None
        self.tf = topics.TF.publisher(self)
        self.refusals = Refusals(self.get_logger().warning)
        infos = self.refusals.guard("camera_info", self.on_info)
        topics.CAMERA_INFO.subscribe(self, infos)
        pictures = self.refusals.guard("image_raw", self.on_picture)
        topics.CAMERA_IMAGE.subscribe(self, pictures)

    def on_info(self, message) -> None:
        self.lens = None
        self.lens = decode_camera_info(message)

    def on_picture(self, message) -> None:
        stamp_ns, picture = decode_image(message)
        size, lens = picture.shape[1::-1], self.lens
        if lens is None:
            raise WireError("camera_info", "a usable one", "none yet", code="wire.uncalibrated")
        if lens.size != size:
            raise WireError("image", f"{lens.size} px, as camera_info", size, code="wire.size")
        model, distortion = lens.model, lens.distortion
        tags = find(self.detector, picture, lens.matrix, self.tag_m, model, distortion)
        placed = {f"{FAMILY}:{number}": body for number, body in tags.items()}
        found = encode_transforms(placed, stamp_ns)
        for transform in found.transforms:
            transform.header.frame_id = message.header.frame_id
        self.tf.publish(found)

    def close(self) -> None:
        pass


if __name__ == "__main__":
    raise SystemExit(run_node("tag_tracker", TagTracker))
