"""Physical facts of the arena, with unit and source, before anything is built from them.

Kinova Jaco, 6 joints, curved wrist, three fingers (j2n6s300). Sources:

- `[urdf]` Kinovarobotics/kinova-ros, `kinova_description/urdf/j2n6s300.xacro`: joint origins and
  limits (the D and e parameters of Kinova's user guide).
- `[inertial]` the same, `kinova_inertial.xacro`: link masses and centers of mass.
- `[dm_control]` google-deepmind/dm_control, `entities/manipulators/kinova/jaco_arm.py`: speeds
  that the firmware allows, and peak torques from Kinova's actuator data sheet.

Joint angles follow Kinova's convention: q2 = q3 = 180° is the arm straight up.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Link:
    """One moving link: where its joint sits in the parent's frame, and a capsule for its body."""

    origin_m: Vector  # [urdf] joint origin in the parent link's frame
    origin_rpy: Vector  # [urdf] rad, rotations about fixed axes x, y, z
    capsule_end_m: Vector  # the capsule runs from the joint to here (the next joint), own frame
    radius_m: float
    mass_kg: float  # [inertial]
    max_speed: float  # rad/s, [dm_control]: 36°/s for joints 1-3, 48°/s for joints 4-6
    max_torque: float  # N m, [dm_control]
    armature: float  # kg m², reflected rotor inertia; our estimate (gear ratio 160 in [urdf])
    velocity_gain: float  # N m s/rad, ours: within one control period, and no higher than what
    # a saturated torque can follow at a physics step of 10 ms (else the joint chatters)
    limits: tuple[float, float] | None  # rad, [urdf]; None is a continuous joint


LARGE_SPEED, SMALL_SPEED = radians(36.0), radians(48.0)
LARGE_TORQUE, SMALL_TORQUE = 30.5, 6.8
_LARGE = (LARGE_SPEED, LARGE_TORQUE, 0.4, 60.0)
_SMALL = (SMALL_SPEED, SMALL_TORQUE, 0.1, 10.0)
_SHOULDER_LIMITS = (radians(47.0), radians(313.0))
_ELBOW_LIMITS = (radians(19.0), radians(341.0))
_WRIST = (0.0, -0.03703, -0.06414)

LINKS = (
    Link((0, 0, 0.15675), (0, pi, 0), (0, 0, -0.11875), 0.04, 0.7477, *_LARGE, None),
    Link(
        (0, 0.0016, -0.11875),
        (-pi / 2, 0, pi),
        (0, -0.410, 0),
        0.04,
        0.99,
        *_LARGE,
        _SHOULDER_LIMITS,
    ),
    Link((0, -0.410, 0), (0, pi, 0), (0, 0.2073, -0.0114), 0.03, 0.6763, *_LARGE, _ELBOW_LIMITS),
    Link((0, 0.2073, -0.0114), (-pi / 2, 0, pi), _WRIST, 0.03, 0.1785, *_SMALL, None),
    Link(_WRIST, (pi / 3, 0, pi), _WRIST, 0.03, 0.1785, *_SMALL, None),
    Link(_WRIST, (pi / 3, 0, pi), (0, 0, -0.08), 0.03, 0.1, *_SMALL, None),
)
BASE_HEIGHT_M = 0.15675  # [urdf] table to joint 1
BASE_RADIUS_M = 0.04  # [inertial]
BASE_MASS_KG = 0.46784  # [inertial]

# The hand: one large white capsule around palm and fingers, which don't move. Its frame is
# Kinova's end-effector frame, 0.16 m along the hand from joint 6 ([urdf]), z pointing away.
HAND_OFFSET_M = (0.0, 0.0, -0.16)
HAND_RPY = (pi, 0.0, 0.0)
HAND_RADIUS_M = 0.045
HAND_HALF_LENGTH_M = 0.03
HAND_MASS_KG = 0.727  # [inertial], hand with three fingers

# Our own table and blocks; the paper gives no sizes.
TABLE_SIDE_M = 1.6
TABLE_THICKNESS_M = 0.04
FLOOR_DEPTH_M = 0.5  # below the table top; catches what falls off
BLOCK_HALF_SIZE_M = 0.03  # of the cube's edge, the sphere's and the cylinder's radius and height
CAPSULE_RADIUS_M = 0.025
CAPSULE_HALF_LENGTH_M = 0.025  # the capsule lies on its side, along the block's x axis
# How far MuJoCo's soft contact lets each shape sink in, m, whatever its mass; measured
# (tests/arena/test_sleep.py holds it). Starting there, nothing moves when a block wakes.
RESTING_DEPTH_M = {"CUBE": 4.36e-5, "SPHERE": 1.69e-4, "CYLINDER": 4.4e-5, "CAPSULE": 8.66e-5}

COLOR_RGBA = {
    "RED": "0.85 0.15 0.15 1",
    "GREEN": "0.15 0.65 0.2 1",
    "BLUE": "0.15 0.3 0.85 1",
    "YELLOW": "0.95 0.85 0.1 1",
    "MAGENTA": "0.85 0.15 0.75 1",
}
