"""MuJoCo model of table, arm and blocks, built from the constants."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from pa_ros.arena import constants as c
from pa_ros.arena.config import ArenaConfig

# Contact bits: two geoms touch if one's type meets the other's affinity. The arm has no type, so
# it never touches itself.
SOLID, BLOCK = 1, 2
# m/s below which a pushed block may fall asleep again. MuJoCo's default, 1e-3, stops a block that
# still rolls; this changes no reward in docs/arena.md's comparison and costs no speed.
SLEEP_TOLERANCE = 1e-5


def build(config: ArenaConfig, shapes: Sequence[str]) -> mujoco.MjModel:
    """Compile the arena with one free block per entry of `shapes`, in that order.

    The initial configuration (qpos0) has the arm in `config.start_pose`; bodies are `link1` …
    `link6`, `hand`, `block0` …, so that the hand and the blocks are consecutive.
    """
    blocks = "".join(_block(config, i, shape) for i, shape in enumerate(shapes))
    return mujoco.MjModel.from_xml_string(f"""
<mujoco model="programmable reaching">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{config.timestep_s}" integrator="implicitfast"
    sleep_tolerance="{SLEEP_TOLERANCE}">
    <flag sleep="{"enable" if config.sleep else "disable"}"/>
  </option>
  <size memory="1M"/>
  <visual><global offwidth="1280" offheight="960"/></visual>
  <worldbody>
    <light pos="0 0 2.5" diffuse="0.7 0.7 0.7"/>
    <camera name="overview" pos="1.1 -1.1 1.1" xyaxes="1 1 0 -0.55 0.55 1"/>
    <geom name="floor" type="plane" size="3 3 0.1" pos="0 0 {-c.FLOOR_DEPTH_M}"
      contype="{SOLID}" conaffinity="0" rgba="0.3 0.3 0.35 1"/>
    <geom name="table" type="box" pos="0 0 {-c.TABLE_THICKNESS_M / 2}"
      size="{c.TABLE_SIDE_M / 2} {c.TABLE_SIDE_M / 2} {c.TABLE_THICKNESS_M / 2}"
      contype="{SOLID}" conaffinity="0" rgba="0.6 0.5 0.4 1"/>
    <geom name="base" type="cylinder" pos="0 0 {c.BASE_HEIGHT_M / 2}"
      size="{c.BASE_RADIUS_M} {c.BASE_HEIGHT_M / 2}" mass="{c.BASE_MASS_KG}"
      {_arm_contact(config)}/>
    {_arm(config)}
    {blocks}
  </worldbody>
  <actuator>{_actuators(config)}</actuator>
</mujoco>""")


def rest_height(shape: str) -> float:
    """Height of a resting block's center above the table, m."""
    half = c.CAPSULE_RADIUS_M if shape == "CAPSULE" else c.BLOCK_HALF_SIZE_M
    return half - c.RESTING_DEPTH_M[shape]


def _arm_contact(config: ArenaConfig) -> str:
    affinity = SOLID | BLOCK if config.arm_touches_blocks else SOLID
    return f'contype="0" conaffinity="{affinity}" rgba="0.25 0.25 0.28 1"'


def _arm(config: ArenaConfig) -> str:
    """Chain of nested bodies; each frame is Kinova's, turned by the start angle (`ref`)."""
    opening, closing = "", ""
    for i, link in enumerate(c.LINKS):
        start = config.start_pose[i]
        limits = f'range="{config.joint_lower[i]} {config.joint_upper[i]}"' if i else ""
        opening += f"""
<body name="link{i + 1}" gravcomp="1" pos="{_text(link.origin_m)}"
  quat="{_text(_quaternion(link.origin_rpy, start))}">
  <joint name="joint{i + 1}" axis="0 0 1" ref="{start}" armature="{link.armature}" {limits}/>
  <geom type="capsule" fromto="0 0 0 {_text(link.capsule_end_m)}" size="{link.radius_m}"
    mass="{link.mass_kg}" {_arm_contact(config)}/>"""
        closing += "</body>"
    hand = f"""
<body name="hand" gravcomp="1" pos="{_text(c.HAND_OFFSET_M)}"
  quat="{_text(_quaternion(c.HAND_RPY, 0.0))}">
  <geom name="hand" type="capsule" size="{c.HAND_RADIUS_M} {c.HAND_HALF_LENGTH_M}"
    mass="{c.HAND_MASS_KG}" {_arm_contact(config).replace("0.25 0.25 0.28", "1 1 1")}/>
</body>"""
    return opening + hand + closing


def _block(config: ArenaConfig, index: int, shape: str) -> str:
    half, radius = c.BLOCK_HALF_SIZE_M, c.CAPSULE_RADIUS_M
    geometry = {
        "CUBE": f'type="box" size="{half} {half} {half}"',
        "SPHERE": f'type="sphere" size="{half}"',
        "CYLINDER": f'type="cylinder" size="{half} {half}"',
        "CAPSULE": f'type="capsule" size="{radius} {c.CAPSULE_HALF_LENGTH_M}"'
        ' quat="0.7071067811865476 0 0.7071067811865476 0"',
    }[shape]
    return f"""
<body name="block{index}" sleep="init" pos="{0.5 + 0.2 * index} 0 {rest_height(shape)}">
  <freejoint/>
  <geom name="block{index}" {geometry} mass="{config.block_mass_kg}" contype="{BLOCK}"
    conaffinity="{SOLID | BLOCK}" condim="6" friction="{config.block_friction} 0.005 0.002"/>
</body>"""


def _actuators(config: ArenaConfig) -> str:
    rows = zip(c.LINKS, config.joint_speed_limits, strict=True)
    return "".join(
        f'<velocity joint="joint{i + 1}" kv="{link.velocity_gain}" '
        f'ctrlrange="{-speed} {speed}" forcerange="{-link.max_torque} {link.max_torque}"/>'
        for i, (link, speed) in enumerate(rows)
    )


def _quaternion(rpy: c.Vector, turn: float) -> tuple[float, ...]:
    """Rotation by rpy (fixed axes, URDF), then about the new z by `turn`; wxyz."""
    fixed, about_z, result = np.zeros(4), np.zeros(4), np.zeros(4)
    mujoco.mju_euler2Quat(fixed, np.array(rpy, dtype=np.float64), "XYZ")
    mujoco.mju_axisAngle2Quat(about_z, np.array([0.0, 0.0, 1.0]), turn)
    mujoco.mju_mulQuat(result, fixed, about_z)
    return tuple(result.tolist())


def _text(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
