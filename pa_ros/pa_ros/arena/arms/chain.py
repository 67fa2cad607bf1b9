"""An arm as a chain of links, built of capsules: MJCF from tables of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from pa_ros.arena.arms.arm import Joint

if TYPE_CHECKING:
    from pa_ros.arena.config import ArenaConfig

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Link:
    """One moving link: where its joint sits in the parent's frame, and a capsule for its body."""

    origin_m: Vector  # of the joint, in the parent link's frame
    origin_rpy: Vector  # rad, rotations about fixed axes x, y, z (URDF)
    capsule_start_m: Vector  # own frame, whose origin is the joint
    capsule_end_m: Vector
    radius_m: float
    mass_kg: float
    armature: float  # kg m², reflected rotor inertia


@dataclass(frozen=True)
class Base:
    """A cylinder that stands on the table and does not move."""

    height_m: float
    radius_m: float
    mass_kg: float


@dataclass(frozen=True)
class Hand:
    """A capsule around palm and fingers, which don't move, in the last link's frame."""

    offset_m: Vector
    rpy: Vector  # rad; z points away from the arm
    radius_m: float
    half_length_m: float
    mass_kg: float


@dataclass(frozen=True)
class Chain:
    """`Arm.mjcf` of a chain: each link in the frame of the one before."""

    base: Base
    joints: Sequence[Joint]
    links: Sequence[Link]  # one for each joint
    hand: Hand

    def __call__(self, config: ArenaConfig, attributes: str) -> str:
        """Nested bodies; each frame is turned by the start angle (`ref`), so that the initial
        configuration (qpos0) is the start pose."""
        base, hand = self.base, self.hand
        bodies = f"""
<geom name="base" type="cylinder" pos="0 0 {base.height_m / 2}"
  size="{base.radius_m} {base.height_m / 2}" mass="{base.mass_kg}" {attributes}/>"""
        for i in range(len(self.links)):
            bodies += self._link(config, i, attributes)
        white = attributes.replace("0.25 0.25 0.28", "1 1 1")
        bodies += f"""
<body name="hand" gravcomp="1" pos="{_text(hand.offset_m)}" quat="{_quaternion(hand.rpy, 0.0)}">
  <geom name="hand" type="capsule" size="{hand.radius_m} {hand.half_length_m}"
    mass="{hand.mass_kg}" {white}/>
</body>"""
        return bodies + "</body>" * len(self.links)

    def _link(self, config: ArenaConfig, i: int, attributes: str) -> str:
        """The opening of a link's body."""
        link, joint, start = self.links[i], self.joints[i], config.start_pose[i]
        limited = joint.limits is not None or i  # a base that turns freely has no range
        limits = f'range="{config.joint_lower[i]} {config.joint_upper[i]}"' if limited else ""
        capsule = f"{_text(link.capsule_start_m)} {_text(link.capsule_end_m)}"
        return f"""
<body name="link{i + 1}" gravcomp="1" pos="{_text(link.origin_m)}"
  quat="{_quaternion(link.origin_rpy, start)}">
  <joint name="{joint.name}" axis="0 0 1" ref="{start}" armature="{link.armature}" {limits}/>
  <geom type="capsule" fromto="{capsule}" size="{link.radius_m}" mass="{link.mass_kg}"
    {attributes}/>"""


def _quaternion(rpy: Vector, turn: float) -> str:
    """Rotation by rpy (fixed axes, URDF), then about the new z by `turn`; wxyz."""
    fixed, about_z, result = np.zeros(4), np.zeros(4), np.zeros(4)
    mujoco.mju_euler2Quat(fixed, np.array(rpy, dtype=np.float64), "XYZ")
    mujoco.mju_axisAngle2Quat(about_z, np.array([0.0, 0.0, 1.0]), turn)
    mujoco.mju_mulQuat(result, fixed, about_z)
    return _text(result.tolist())


def _text(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
