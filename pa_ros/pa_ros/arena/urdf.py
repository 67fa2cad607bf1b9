"""The arm of a compiled model as URDF, for viewers and planners, with MuJoCo's geoms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree as ET

import mujoco
import numpy as np

ROOT, HAND = "world", "hand"
FRAMES = HAND, "base"  # the arena publishes their poses itself, and a frame has one parent in tf
_CAPSULE, _CYLINDER = int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_BOX, _SPHERE = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_SPHERE)


def urdf(model: mujoco.MjModel, name: str, speed_limits: Sequence[float]) -> str:
    """URDF of the chain from the table to the hand. Joints have their names on the graph.

    Joint positions have the same zero as `joint_states`. URDF lacks capsules, so they become
    cylinders with two spheres. The links have shapes but no masses.
    """
    robot = ET.Element("robot", name=name)
    _link(robot, model, 0, ROOT)
    for number, body in enumerate(_chain(model)):
        own, parent = (link_name(model, one) for one in (body, model.body_parentid[body]))
        _link(robot, model, body, own)
        _joint(robot, model, body, own, parent, speed_limits, number)
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode")


def link_name(model: mujoco.MjModel, body: int) -> str:
    """The name of a body's link: its own, or `hand_link` for the hand."""
    name = str(model.body(body).name)
    return f"{name}_link" if name in FRAMES else name


def _chain(model: mujoco.MjModel) -> list[int]:
    """Body ids from the first link to the hand."""
    found = [model.body(HAND).id]
    while model.body_parentid[found[0]]:
        found.insert(0, int(model.body_parentid[found[0]]))
    return found


def _joint(
    robot: ET.Element,
    model: mujoco.MjModel,
    body: int,
    name: str,
    parent: str,
    speed_limits: Sequence[float],
    number: int,
) -> None:
    first, count = model.body_jntadr[body], model.body_jntnum[body]
    pose = model.body_quat[body]
    if count == 0:
        joint = _child(robot, "joint", name=f"{name}_fixed", type="fixed")
    else:
        limited = bool(model.jnt_limited[first])
        kind = "revolute" if limited else "continuous"
        joint = _child(robot, "joint", name=model.joint(first).name, type=kind)
        # MuJoCo's frame of a body is turned by the joint's reference angle.
        reference = model.qpos0[model.jnt_qposadr[first]]
        pose = _turned(pose, model.jnt_axis[first], -reference)
        _child(joint, "axis", xyz=_text(model.jnt_axis[first]))
        low, high = model.jnt_range[first] if limited else (-np.pi, np.pi)
        bounds = {"lower": repr(float(low)), "upper": repr(float(high))} if limited else {}
        _child(joint, "limit", velocity=repr(float(speed_limits[number])), effort="0", **bounds)
    _child(joint, "parent", link=parent)
    _child(joint, "child", link=name)
    _origin(joint, model.body_pos[body], pose)


def _link(robot: ET.Element, model: mujoco.MjModel, body: int, name: str) -> None:
    link = _child(robot, "link", name=name)
    for geom in range(model.ngeom):
        base = body == 0 and model.geom(geom).name in ("floor", "table")  # not part of the arm
        if model.geom_bodyid[geom] == body and not base:
            _visuals(link, model, geom)


def _visuals(link: ET.Element, model: mujoco.MjModel, geom: int) -> None:
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    place, pose = model.geom_pos[geom], model.geom_quat[geom]
    rgba = _text(model.geom_rgba[geom])

    def shape(tag: str, at: Any, **sizes: Any) -> None:
        visual = _child(link, "visual")
        _origin(visual, at, pose)
        _child(_child(visual, "geometry"), tag, **{k: _text(v) for k, v in sizes.items()})
        _child(_child(visual, "material", name=f"color_{geom}"), "color", rgba=rgba)

    if kind in (_CAPSULE, _CYLINDER):
        shape("cylinder", place, radius=size[0], length=2 * size[1])
    if kind == _SPHERE:
        shape("sphere", place, radius=size[0])
    if kind == _CAPSULE:
        along = np.zeros(3)
        mujoco.mju_rotVecQuat(along, np.array([0.0, 0.0, size[1]]), pose)
        # URDF has no capsules: a cylinder with a sphere at each end looks the same.
        for end in (place - along, place + along):
            shape("sphere", end, radius=size[0])
    if kind == _BOX:
        shape("box", place, size=2 * size)


def _turned(pose: Any, axis: Any, angle: float) -> Any:
    about, result = np.zeros(4), np.zeros(4)
    mujoco.mju_axisAngle2Quat(about, axis, angle)
    mujoco.mju_mulQuat(result, pose, about)
    return result


def _origin(element: ET.Element, position: Any, quaternion: Any) -> None:
    """Add an origin; URDF has rotations about fixed axes x, y, z instead of quaternions."""
    w, x, y, z = quaternion
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    _child(element, "origin", xyz=_text(position), rpy=_text((roll, pitch, yaw)))


def _child(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    return ET.SubElement(parent, tag, attributes)


def _text(values: Any) -> str:
    return " ".join(f"{float(value):.9g}" for value in np.atleast_1d(values))
