"""Messages of real robots: transforms, joint states, detections, and a table's markers."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from control_msgs.action import GripperCommand
from control_msgs.msg import JointJog
from geometry_msgs.msg import Point, PoseStamped, TwistStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from vision_msgs.msg import Detection3DArray
from visualization_msgs.msg import Marker, MarkerArray

from pa_ros.core.experience import Float64
from pa_ros.wire import LONGEST, Message, WireError
from pa_ros.wire.fields import NS, header_stamp, read_array, write_stamp, write_vector
from pa_ros.wire.step import LARGEST

Measurement = tuple[str, str, Float64, int]
"""Parent frame, child frame, pose [7] of the child in its parent, stamp in ns."""
Refuse = Callable[[WireError], object]
"""Receives why one wanted entry of a message cannot be used. The others are used."""
UNIT = 0.9, 1.1  # accepted lengths of a unit quaternion
LITTLE_ENDIAN = b"\0\1"  # begins a message in CDR
COUNT, HEADER, POSE = struct.Struct("<I"), struct.Struct("<iII"), struct.Struct("<7d")
LABEL_M, ARROW_M = 0.04, 0.01  # sizes of markers
ARROW_S = 0.5  # an arrow shows where the hand would be then


def decode_transforms(
    payload: bytes, wanted: Iterable[str] | None, refuse: Refuse
) -> tuple[list[Measurement], set[str]]:
    """The transforms of wanted frames and of those above them; and the names of all child frames.

    Reads the bytes of a tf2_msgs/TFMessage itself: rclpy takes 15 µs for each transform, and most
    are of frames that nobody wants. The last one of a frame counts. Raises WireError if the bytes
    are no such message.

    :param wanted: child frames; None: all.
    """
    entries = _transform_entries(payload)
    children, measured = set(entries), []
    frames = list(entries if wanted is None else wanted)
    for child in frames:
        if child not in entries:
            continue
        parent, stamp_ns, numbers = entries.pop(child)
        frames.append(parent)
        name, pose = f"tf.{child[:LONGEST]}", POSE.unpack(numbers)
        try:
            measured.append(_measurement(name, parent, child, pose, stamp_ns))
        except WireError as error:
            refuse(error)
    return measured, children


def _transform_entries(payload: bytes) -> dict[str, tuple[str, int, bytes]]:
    """The parent, the stamp (ns) and the pose's bytes of each child frame in a TFMessage."""
    if payload[:2] != LITTLE_ENDIAN:
        expected = "little-endian CDR"
        raise WireError("tf", expected, f"bytes {payload[:4]!r}", code="wire.encoding")
    body, at, entries = payload[4:], COUNT.size, {}
    cut = WireError("tf", "a whole TFMessage", f"{len(payload)} bytes", code="wire.truncated")
    try:
        for _ in range(*COUNT.unpack_from(body)):
            sec, nanosec, length = HEADER.unpack_from(body, at)
            parent, at = _text(body, at + HEADER.size, length)
            at += -at % 4
            (length,) = COUNT.unpack_from(body, at)
            child, at = _text(body, at + COUNT.size, length)
            at += -at % 8
            numbers, at = body[at : at + POSE.size], at + POSE.size
            entries[child.removeprefix("/")] = parent.removeprefix("/"), sec * NS + nanosec, numbers
    except struct.error:
        raise cut from None
    if at > len(body):
        raise cut
    return entries


def _text(body: bytes, at: int, length: int) -> tuple[str, int]:
    """A text that ends with a zero byte, and where it ends."""
    return body[at : at + length - 1].decode(errors="replace"), at + length


def decode_tracked(message: PoseStamped, name: str) -> Measurement:
    """A tracker's pose as that of the frame `name`. Raises WireError."""
    numbers = _pose_numbers(message.pose)
    return _measurement("pose", message.header.frame_id, name, numbers, header_stamp(message))


def decode_detections(
    message: Detection3DArray, wanted: Mapping[str, str], refuse: Refuse
) -> list[Measurement]:
    """The detection of each wanted class with the highest score.

    Its pose is that in `results` or, where a detector leaves that empty, `bbox.center`.

    :param wanted: the frame that gets a class's pose, by class.
    """
    best: dict[str, tuple[float, Any, Any]] = {}
    for detection in message.detections:
        for guess in detection.results:
            kind, score = str(guess.hypothesis.class_id), float(guess.hypothesis.score)
            score = -math.inf if math.isnan(score) else score
            if kind in wanted and (kind not in best or score > best[kind][0]):
                best[kind] = score, detection, guess
    measured = []
    for kind, (score, detection, guess) in best.items():
        name, frame = f"detections.{kind}", detection.header.frame_id or message.header.frame_id
        try:
            if score == -math.inf:
                raise WireError(f"{name}.score", "a number", "none", code="wire.non_finite")
            numbers = _filled_pose(name, guess.pose.pose, detection.bbox.center)
            part = _measurement(name, frame, wanted[kind], numbers, header_stamp(message))
            measured.append(part)
        except WireError as error:
            refuse(error)
    return measured


def _filled_pose(name: str, *poses: Any) -> list[float]:
    """The numbers of the first pose that is not at its frame's origin. Raises WireError."""
    for numbers in map(_pose_numbers, poses):
        if any(numbers[:6]) or numbers[6] not in (0.0, 1.0):
            return numbers
    raise WireError(name, "a pose in results or in bbox.center", "none", code="wire.range")


def _pose_numbers(pose: Any) -> list[float]:
    place, turn = pose.position, pose.orientation
    return [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]


def _measurement(
    name: str, parent: str, child: str, numbers: Sequence[float], stamp_ns: int
) -> Measurement:
    """A measurement whose pose has a quaternion of length 1. Raises WireError."""
    if not 0 < len(parent) <= LONGEST:
        expected = f"the name of the frame that it is in, 1 to {LONGEST} characters"
        raise WireError(f"{name}.header.frame_id", expected, repr(parent), code="wire.frame")
    pose = read_array(name, numbers, np.float64, (7,), LARGEST)
    length = math.hypot(*numbers[3:])
    if not UNIT[0] <= length <= UNIT[1]:
        expected = "a quaternion of length 1"
        raise WireError(f"{name}.orientation", expected, f"length {length}", code="wire.range")
    pose[3:] /= length
    return parent.removeprefix("/"), child, pose, stamp_ns


def decode_driver_joints(
    message: JointState, names: Sequence[str]
) -> tuple[Float64, Float64, int] | None:
    """Positions [J] (rad), velocities [J] (rad/s) and the stamp (ns) of the named joints;
    None for a message about other joints. Raises WireError."""
    received = list(message.name)
    missing = [name for name in names if name not in received]
    if len(missing) == len(names):
        return None
    if missing:
        expected = "all joints of the arm in one message"
        raise WireError("joint_states.name", expected, f"none of {missing}", "wire.joint_names")
    twice = [name for name in names if received.count(name) > 1]
    if twice:
        raise WireError("joint_states.name", "each joint once", twice, code="wire.joint_names")
    order = [received.index(name) for name in names]
    position = _chosen("joint_states.position", message.position, order, len(received))
    velocity = _chosen("joint_states.velocity", message.velocity, order, len(received))
    return position, velocity, header_stamp(message)


def _chosen(name: str, values: Sequence[float], order: Sequence[int], count: int) -> Float64:
    """Some entries of an array that may lack its last ones. Raises WireError."""
    if not max(order) < len(values) <= count:
        received = len(values) or "none: does the driver publish them?"
        raise WireError(name, f"{count} numbers, one for each name", received, code="wire.size")
    return read_array(name, [values[i] for i in order], np.float64, (len(order),), LARGEST)


def decode_holds(message: Bool) -> bool:
    """Whether a gripper says that it holds something."""
    return bool(message.data)


def decode_finger(message: JointState, name: str) -> float | None:
    """The position of one joint; None for a message about others."""
    return next((at for joint, at in zip(message.name, message.position, strict=False)
                 if joint == name), None)  # fmt: skip


def decode_takeover(message: TwistStamped) -> tuple[str, Float64, Float64]:
    """The frame, and the hand's linear (m/s) and angular (rad/s) velocity in it, [3] each. Raises
    WireError."""
    linear, angular = message.twist.linear, message.twist.angular
    read = (
        read_array(f"takeover.{name}", (one.x, one.y, one.z), np.float64, (3,), LARGEST)
        for name, one in (("linear", linear), ("angular", angular))
    )
    return message.header.frame_id.removeprefix("/"), *read


def decode_jog(message: JointJog, names: Sequence[str]) -> Float64:
    """The velocities [J] (rad/s) of the named joints; 0 for a joint that the message leaves out.
    Raises WireError."""
    received = list(message.joint_names)
    if not {*received} <= {*names} or len({*received}) != len(received):
        expected = f"some of {list(names)}, each once"
        raise WireError("takeover_joints.joint_names", expected, received, "wire.joint_names")
    given = message.velocities, np.float64, (len(received),)
    told = read_array("takeover_joints.velocities", *given, LARGEST)
    return np.array([told[received.index(name)] if name in received else 0.0 for name in names])


def encode_takeover(linear: Float64) -> TwistStamped:
    """The hand's velocity [3] (m/s) in the base's frame."""
    message = TwistStamped()
    write_vector(message.twist.linear, linear)
    return message


def encode_valve(on: bool) -> Message:
    """Whether a vacuum cup is to be on."""
    return Message(Bool(data=on))


def encode_fingers(gap_m: float, max_effort: float) -> GripperCommand.Goal:
    """A gap for fingers to move to, and the greatest effort (N)."""
    goal = GripperCommand.Goal()
    goal.command.position, goal.command.max_effort = gap_m, max_effort
    return goal


def encode_table(
    frame: str,
    box: tuple[Sequence[float], Sequence[float]],
    objects: Mapping[str, Float64],
    hand_velocity: Float64,
    stamp_ns: int,
) -> MarkerArray:
    """The workspace, the measured hand and objects, and where the hand would move.

    :param frame: of all positions, m.
    :param box: lower and upper corner.
    :param objects: measured poses [7] by name; the hand's name is "hand".
    :param hand_velocity: [3] m/s.
    """
    lower, upper = map(np.array, box)
    room = Marker(ns="workspace", type=Marker.CUBE)
    write_vector(room.pose.position, (lower + upper) / 2)
    write_vector(room.scale, upper - lower)
    room.color.g, room.color.a = 1.0, 0.1
    markers = [Marker(action=Marker.DELETEALL), room]
    for i, (name, pose) in enumerate(objects.items()):
        label = Marker(ns="names", id=i, type=Marker.TEXT_VIEW_FACING, text=name)
        write_vector(label.pose.position, pose[:3])
        label.scale.z = LABEL_M
        label.color.r = label.color.g = label.color.b = label.color.a = 1.0
        markers.append(label)
    if "hand" in objects:
        arrow, start = Marker(ns="motion", type=Marker.ARROW), objects["hand"][:3]
        arrow.scale.x, arrow.scale.y = ARROW_M, 2 * ARROW_M
        arrow.color.r = arrow.color.a = 1.0
        ends = (start, start + ARROW_S * hand_velocity)
        arrow.points = [Point(x=x, y=y, z=z) for x, y, z in (end.tolist() for end in ends)]
        markers.append(arrow)
    for marker in markers:
        marker.header.frame_id = frame
        write_stamp(marker.header.stamp, stamp_ns)
    return MarkerArray(markers=markers)
