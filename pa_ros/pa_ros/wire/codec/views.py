"""What viewers show: transforms, markers, a description."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pa_ros.core.body import Body
from pa_ros.wire.codec.simulator import WORLD, write_vector
from pa_ros.wire.codec.stamp import write_stamp
from pa_ros.wire.interfaces import Marker, MarkerArray, String, TransformStamped
from pa_ros.wire.simulator import Solid

_TYPES = {"box": Marker.CUBE, "sphere": Marker.SPHERE, "cylinder": Marker.CYLINDER}
LETTERS_M = 0.04  # height of a label's capitals
ABOVE_M = 0.07  # of a label over its block's center


def encode_text(text: str) -> String:
    """Plain text."""
    return String(data=text)


def encode_transform(name: str, body: Body, stamp_ns: int) -> TransformStamped:
    """The pose of one body, as the frame of its name in the frame WORLD."""
    message = TransformStamped(child_frame_id=name)
    message.header.frame_id = WORLD
    write_stamp(message.header.stamp, stamp_ns)
    write_vector(message.transform.translation, body.position)
    write_vector(message.transform.rotation, body.quaternion, "xyzw")
    return message


def encode_markers(solids: Sequence[Solid], stamp_ns: int, shown: int = 0) -> MarkerArray:
    """Each solid and its label; of `shown` solids of the message before, those gone are deleted."""
    markers = []
    for i, solid in enumerate(solids):
        kind = _TYPES.get(solid.shape, Marker.CYLINDER)
        body = _marker("blocks", i, kind, solid.body, stamp_ns)
        write_vector(body.scale, solid.scale)
        _color(body, solid.rgba)
        label = _marker("labels", i, Marker.TEXT_VIEW_FACING, solid.body, stamp_ns)
        label.pose.position.z += ABOVE_M
        label.scale.z, label.text = LETTERS_M, solid.name
        _color(label, (1.0, 1.0, 1.0, 1.0))
        markers += [body, label]
    for i in range(len(solids), shown):
        for space in ("blocks", "labels"):
            gone = Marker(ns=space, id=i, action=Marker.DELETE)
            gone.header.frame_id = WORLD
            markers.append(gone)
    return MarkerArray(markers=markers)


def encode_outlines(array: MarkerArray, relevance: Sequence[float]) -> MarkerArray:
    """Around each block of an arena's markers a shell that is as opaque as p says, in Ω's order."""
    blocks = [marker for marker in array.markers if marker.ns == "blocks"]
    for marker in blocks:
        marker.ns = "relevance"
        p = relevance[marker.id] if 0 <= marker.id < len(relevance) else 0.0
        for name in "xyz":
            setattr(marker.scale, name, getattr(marker.scale, name) * 1.4)
        _color(marker, (1.0, 1.0, 1.0, 0.5 * p))
    return MarkerArray(markers=blocks)


def _marker(space: str, number: int, kind: int, body: Body, stamp_ns: int) -> Any:
    marker = Marker(ns=space, id=number, type=kind, action=Marker.ADD)
    marker.header.frame_id = WORLD
    write_stamp(marker.header.stamp, stamp_ns)
    write_vector(marker.pose.position, body.position)
    write_vector(marker.pose.orientation, body.quaternion, "xyzw")
    return marker


def _color(marker: Any, rgba: Sequence[float]) -> None:
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = map(float, rgba)
