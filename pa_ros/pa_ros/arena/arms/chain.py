"""An arm as a chain of links with capsules: MJCF from tables of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from pa_ros.arena.arms.arm import Joint, VacuumCup

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Link:
    """A moving link: the place of its joint in the parent's frame, and a capsule as its body."""

    origin_m: Vector  # of the joint, in the parent link's frame
    origin_rpy: Vector  # rad, rotations about fixed axes x, y, z (URDF)
    capsule_start_m: Vector  # in the link's own frame, whose origin is the joint
    capsule_end_m: Vector
    radius_m: float
    mass_kg: float
    armature: float  # kg m², reflected rotor inertia


@dataclass(frozen=True)
class Base:
    """A fixed cylinder on the table."""

    height_m: float
    radius_m: float
    mass_kg: float


@dataclass(frozen=True)
class HandCapsule:
    """A capsule around palm and fingers, which do not move, in the last link's frame."""

    offset_m: Vector
    rpy: Vector  # rad; z points away from the arm
    radius_m: float
    half_length_m: float
    mass_kg: float

    @property
    def cup(self) -> VacuumCup:
        """A vacuum cup at its end."""
        return VacuumCup(reach_m=self.half_length_m + self.radius_m)


@dataclass(frozen=True)
class Chain:
    """The function `ArmModel.mjcf` of a chain, in which each link is placed in the frame of the
    previous one."""

    base: Base
    joints: Sequence[Joint]
    links: Sequence[Link]  # one for each joint
    hand: HandCapsule

    def __call__(self, attributes: str) -> str:
        """Nested bodies. Each frame is turned by its start angle (`ref`), so that MuJoCo's initial
        configuration (qpos0) is the start pose."""
        base, hand = self.base, self.hand
        bodies = f"""
<geom name="base" type="cylinder" pos="0 0 {base.height_m / 2}"
  size="{base.radius_m} {base.height_m / 2}" mass="{base.mass_kg}" {attributes}/>"""
        for i in range(len(self.links)):
            bodies += self._link(i, attributes)
        bodies += f"""
<body name="hand" gravcomp="1" pos="{_text(hand.offset_m)}" quat="{_quaternion(hand.rpy, 0.0)}">
  <geom name="hand" type="capsule" size="{hand.radius_m} {hand.half_length_m}"
    mass="{hand.mass_kg}" {attributes}/>
</body>"""
        return bodies + "</body>" * len(self.links)

    def _link(self, i: int, attributes: str) -> str:
        """The opening tag of a link's body, with its joint and geom."""
        link, joint = self.links[i], self.joints[i]
        # MuJoCo needs no range for a base that turns freely.
        limited = joint.limits is not None or i
        limits = f'range="{joint.lower} {joint.upper}"' if limited else ""
        capsule = f"{_text(link.capsule_start_m)} {_text(link.capsule_end_m)}"
        return f"""
<body name="link{i + 1}" gravcomp="1" pos="{_text(link.origin_m)}"
  quat="{_quaternion(link.origin_rpy, joint.start)}">
  <joint name="{joint.name}" axis="0 0 1" ref="{joint.start}" armature="{link.armature}" {limits}/>
  <geom type="capsule" fromto="{capsule}" size="{link.radius_m}" mass="{link.mass_kg}"
    {attributes}/>"""


def _quaternion(rpy: Vector, turn: float) -> str:
    """Rotation by rpy (fixed axes, URDF), then about the new z axis by `turn` rad; wxyz."""
    fixed, about_z, result = np.zeros(4), np.zeros(4), np.zeros(4)
    mujoco.mju_euler2Quat(fixed, np.array(rpy, dtype=np.float64), "XYZ")
    mujoco.mju_axisAngle2Quat(about_z, np.array([0.0, 0.0, 1.0]), turn)
    mujoco.mju_mulQuat(result, fixed, about_z)
    return _text(result.tolist())


def _text(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
