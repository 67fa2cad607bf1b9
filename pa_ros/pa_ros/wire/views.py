"""Messages for other ROS programs: markers, transforms, camera pictures, poses, controllers."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from control_msgs.msg import JointJog
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float64MultiArray, String
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker, MarkerArray

from pa_ros.core.experience import Body, Float64
from pa_ros.wire import Message, WireError
from pa_ros.wire.fields import read_stamp, read_vector, write_stamp, write_vector
from pa_ros.wire.simulator import WORLD

MARKERS = {"box": Marker.CUBE, "sphere": Marker.SPHERE, "cylinder": Marker.CYLINDER}
OPTICAL_FRAME = "camera_optical_frame"
LABEL_HEIGHT_M = 0.04  # of capital letters
LABEL_ABOVE_M = 0.07  # a block's center
SAME_M = 0.1  # from a marker to the object that it shows
SHELL = 1.4  # size of a relevance marker, relative to its block
RGB, BGR, GREY = slice(0, 3), slice(2, None, -1), [0, 0, 0]
ENCODINGS: dict[str, tuple[str, int, Any]] = {
    # of pictures: type and count of a pixel's numbers, and which are red, green and blue
    "rgb8": ("u1", 3, RGB),
    "bgr8": ("u1", 3, BGR),
    "rgba8": ("u1", 4, RGB),
    "bgra8": ("u1", 4, BGR),
    "mono8": ("u1", 1, GREY),
    "mono16": ("u2", 1, GREY),
}
DISTORTIONS = {  # how many coefficients the model of a lens may have
    "": (0, 4, 5),
    "plumb_bob": (0, 4, 5),
    "rational_polynomial": (8, 12, 14),
    "equidistant": (4,),
}


@dataclass(frozen=True, slots=True)
class Lens:
    """The intrinsics of a camera."""

    matrix: Float64  # K, [3, 3] px
    model: str  # of its distortion, one of DISTORTIONS
    distortion: Float64  # coefficients D of the model
    size: tuple[int, int]  # width and height of its pictures, px


@dataclass(frozen=True, slots=True)
class Solid:
    """The shape and color of a block."""

    name: str
    shape: str  # "box", "sphere", "cylinder" or "capsule"
    scale: Float64  # [3] m, whole lengths along its own axes
    rgba: tuple[float, ...]  # [4]
    body: Body


# For viewers


def encode_text(text: str) -> String:
    """Plain text."""
    return String(data=text)


def encode_transforms(bodies: Mapping[str, Body], stamp_ns: int) -> TFMessage:
    """The poses of bodies in the frame WORLD, by the names of their own frames."""
    transforms = []
    for name, body in bodies.items():
        placed = TransformStamped(child_frame_id=name)
        placed.header.frame_id = WORLD
        write_stamp(placed.header.stamp, stamp_ns)
        write_vector(placed.transform.translation, body.position)
        write_vector(placed.transform.rotation, body.quaternion, "xyzw")
        transforms.append(placed)
    return TFMessage(transforms=transforms)


def encode_markers(solids: Sequence[Solid], stamp_ns: int, shown: int = 0) -> MarkerArray:
    """A marker and a label for each solid.

    :param shown: number of solids in the last message; markers of those that are gone are deleted.
    """
    markers = []
    for i, solid in enumerate(solids):
        kind = MARKERS.get(solid.shape, Marker.CYLINDER)  # there is no capsule
        block = _marker("blocks", i, kind, solid.body, stamp_ns)
        write_vector(block.scale, solid.scale)
        _color(block, solid.rgba)
        label = _marker("labels", i, Marker.TEXT_VIEW_FACING, solid.body, stamp_ns)
        label.pose.position.z += LABEL_ABOVE_M
        label.scale.z, label.text = LABEL_HEIGHT_M, solid.name
        _color(label, (1.0, 1.0, 1.0, 1.0))
        markers += [block, label]
    for i in range(len(solids), shown):
        for space in ("blocks", "labels"):
            gone = Marker(ns=space, id=i, action=Marker.DELETE)
            gone.header.frame_id = WORLD
            markers.append(gone)
    return MarkerArray(markers=markers)


def encode_outlines(
    markers: MarkerArray, places: Float64, relevance: Sequence[float]
) -> MarkerArray | None:
    """A shell around each block of an arena's markers, as opaque as p; None without blocks.

    :param places: where the observed objects are, [N, 3] m. A camera sees them in another order.
    :param relevance: p of each of them; a block that is not among them has 0.
    """
    blocks = [marker for marker in markers.markers if marker.ns == "blocks"]
    for marker in blocks:
        marker.ns = "relevance"
        distances = np.linalg.norm(places - read_vector(marker.pose.position), axis=1)
        nearest = int(distances.argmin())
        p = relevance[nearest] if len(relevance) and distances[nearest] < SAME_M else 0.0
        for name in "xyz":
            setattr(marker.scale, name, getattr(marker.scale, name) * SHELL)
        _color(marker, (1.0, 1.0, 1.0, 0.5 * p))
    return MarkerArray(markers=blocks) if blocks else None


def encode_image(picture: NDArray[np.uint8], frame: str, stamp_ns: int) -> Image:
    """A picture [height, width, 3] RGB, seen from the optical frame `frame`."""
    height, width, channels = picture.shape
    message = Image(height=height, width=width, encoding="rgb8", step=channels * width)
    message.header.frame_id = frame
    write_stamp(message.header.stamp, stamp_ns)
    message.data = array("B", picture.tobytes())
    return message


def encode_camera_info(
    matrix: Float64, width: int, height: int, frame: str, stamp_ns: int
) -> CameraInfo:
    """The intrinsics of a camera without distortion.

    :param matrix: K [3, 3] px.
    :param frame: the camera's optical frame.
    """
    message = CameraInfo(height=height, width=width, distortion_model="plumb_bob", d=[0.0] * 5)
    message.header.frame_id = frame
    write_stamp(message.header.stamp, stamp_ns)
    message.k, message.r = matrix.ravel(), np.eye(3).ravel()
    message.p = np.hstack([matrix, np.zeros((3, 1))]).ravel()
    return message


def decode_image(message: Image) -> tuple[int, NDArray[np.uint8]]:
    """The stamp (ns) of a picture, and the picture: RGB, [height, width, 3].

    Raises WireError (`wire.encoding`) unless it is one of ENCODINGS, `wire.size` if it is not
    whole.
    """
    if message.encoding not in ENCODINGS:
        expected = f"one of {', '.join(ENCODINGS)}"
        raise WireError("image.encoding", expected, message.encoding, code="wire.encoding")
    kind, channels, colors = ENCODINGS[message.encoding]
    number = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    height, width, step = message.height, message.width, message.step
    row, data = channels * width * number.itemsize, np.frombuffer(message.data, np.uint8)
    if not 0 < row <= step or len(data) != height * step or not height:
        expected = f"{height} rows of {step} bytes, at least {max(row, 1)}"
        raise WireError("image.data", expected, f"{len(data)} bytes", code="wire.size")
    rows = np.ascontiguousarray(data.reshape(height, step)[:, :row])
    picture = rows.view(number).reshape(height, width, channels)[..., colors]
    picture = picture if number.itemsize == 1 else picture >> 8
    return read_stamp(message.header.stamp), np.ascontiguousarray(picture, np.uint8)


def decode_camera_info(message: CameraInfo) -> Lens:
    """The intrinsics of a camera.

    Raises WireError (`wire.uncalibrated`) if it has none, or a distortion of another kind than
    DISTORTIONS.
    """
    matrix = np.array(message.k, np.float64).reshape(3, 3)
    fits = np.isfinite(matrix).all() and matrix[0, 0] > 0 and matrix[1, 1] > 0
    if not fits or matrix[2].tolist() != [0.0, 0.0, 1.0]:
        expected = "the matrix of a calibrated camera"
        raise WireError("camera_info.k", expected, list(message.k), code="wire.uncalibrated")
    model, distortion = message.distortion_model, np.array(message.d, np.float64)
    if len(distortion) not in DISTORTIONS.get(model, ()) or not np.isfinite(distortion).all():
        models = ", ".join(filter(None, DISTORTIONS))
        expected = f"one of {models} with finite coefficients of that model"
        got = f"{model} with {distortion.tolist()}"
        raise WireError("camera_info.d", expected, got, code="wire.uncalibrated")
    return Lens(matrix, model, distortion, (message.width, message.height))


def _marker(space: str, number: int, kind: int, body: Body, stamp_ns: int) -> Any:
    marker = Marker(ns=space, id=number, type=kind, action=Marker.ADD)
    marker.header.frame_id = WORLD
    write_stamp(marker.header.stamp, stamp_ns)
    write_vector(marker.pose.position, body.position)
    write_vector(marker.pose.orientation, body.quaternion, "xyzw")
    return marker


def _color(marker: Any, rgba: Sequence[float]) -> None:
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = map(float, rgba)


def encode_setpoint(
    form: str,
    names: Sequence[str],
    position: Float64,
    velocity: Float64,
    period_s: float,
    stamp_ns: int,
) -> Message:
    """A command for ros2_control or MoveIt Servo that holds for one control period.

    :param form: `velocity` (an array in the order of the joints), `joint_trajectory` (one point a
        period ahead) or `joint_jog`.
    :param position: of the joints now, [J] rad.
    :param velocity: [J] rad/s.
    """
    if form == "joint_trajectory":
        target = (position + velocity * period_s).tolist()
        point = JointTrajectoryPoint(positions=target, velocities=velocity.tolist())
        write_stamp(point.time_from_start, round(period_s * 1e9))
        return Message(JointTrajectory(joint_names=list(names), points=[point]))
    if form == "joint_jog":
        jog = JointJog(joint_names=list(names), velocities=velocity.tolist(), duration=period_s)
        write_stamp(jog.header.stamp, stamp_ns)
        return Message(jog)
    return Message(Float64MultiArray(data=velocity.tolist()))
