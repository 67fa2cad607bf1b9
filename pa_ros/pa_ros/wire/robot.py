"""Messages of real robots: transforms, joint states, detections, and a table's markers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from geometry_msgs.msg import Point, PoseStamped
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage
from vision_msgs.msg import Detection3DArray
from visualization_msgs.msg import Marker, MarkerArray

from pa_ros.core.experience import Float64
from pa_ros.wire.fields import header_stamp, read_array, write_stamp, write_vector
from pa_ros.wire.step import LARGEST
from pa_ros.wire.views import read_pose

Measurement = tuple[str, str, Float64, int]
"""Parent frame, child frame, pose [7] of the child in its parent, stamp in ns."""
LABEL_M, ARROW_M = 0.04, 0.01  # sizes of markers
ARROW_S = 0.5  # an arrow shows where the hand would be then


def decode_transforms(message: TFMessage) -> list[Measurement]:
    """The transforms of tf. Raises WireError."""
    found = []
    for one in message.transforms:
        moved = one.transform
        pose = read_pose(f"tf.{one.child_frame_id}", moved.translation, moved.rotation)
        found.append((one.header.frame_id, one.child_frame_id, pose, header_stamp(one)))
    return found


def decode_tracked(message: PoseStamped, name: str) -> Measurement:
    """A tracker's pose as that of the frame `name`. Raises WireError."""
    pose = read_pose("pose", message.pose.position, message.pose.orientation)
    return str(message.header.frame_id), name, pose, header_stamp(message)


def decode_detections(message: Detection3DArray, wanted: Mapping[str, str]) -> list[Measurement]:
    """The detection of each wanted class with the highest score. Raises WireError.

    :param wanted: the frame that gets a class's pose, by class.
    """
    best: dict[str, tuple[float, Measurement]] = {}
    for found in message.detections:
        for result in found.results:
            kind, score = str(result.hypothesis.class_id), float(result.hypothesis.score)
            if kind in wanted and not score <= best.get(kind, (-np.inf,))[0]:
                placed = result.pose.pose
                pose = read_pose(f"detections.{kind}", placed.position, placed.orientation)
                frame = found.header.frame_id or message.header.frame_id
                best[kind] = score, (frame, wanted[kind], pose, header_stamp(message))
    return [one for _, one in best.values()]


def decode_driver_joints(
    message: JointState, names: Sequence[str]
) -> tuple[Float64, Float64, int] | None:
    """Positions [J] (rad), velocities [J] (rad/s) and the stamp (ns) of the named joints;
    None for a message about other joints. Raises WireError."""
    received = list(message.name)
    if not set(names) <= set(received):
        return None
    order, shape = [received.index(name) for name in names], (len(received),)
    position = read_array("joint_states.position", message.position, np.float64, shape, LARGEST)
    velocity = read_array("joint_states.velocity", message.velocity, np.float64, shape, LARGEST)
    return position[order], velocity[order], header_stamp(message)


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
