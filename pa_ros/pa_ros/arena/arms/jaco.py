"""Kinova Jaco, 6 joints, curved wrist, three fingers (j2n6s300). Sources:

- `[urdf]` Kinovarobotics/kinova-ros, `kinova_description/urdf/j2n6s300.xacro`: joint origins and
  limits (the D and e parameters of Kinova's user guide).
- `[inertial]` the same, `kinova_inertial.xacro`: link masses and centers of mass.
- `[dm_control]` google-deepmind/dm_control, `entities/manipulators/kinova/jaco_arm.py`: speeds
  that the firmware allows, and peak torques from Kinova's actuator data sheet.

Joint angles follow Kinova's convention: q2 = q3 = 180° is the arm straight up.
"""

from __future__ import annotations

from math import pi, radians

from pa_ros.arena.arms.arm import ArmModel, Joint, Range
from pa_ros.arena.arms.chain import Base, Chain, HandCapsule, Link

# rad/s and N m [dm_control]; the gain (ours) reaches a velocity within one control period, and is
# low enough for a saturated torque to follow at a physics step of 10 ms (otherwise the joint
# chatters). Joints 1-3, then 4-6.
_LARGE = (radians(36.0), 30.5, 60.0)
_SMALL = (radians(48.0), 6.8, 10.0)
# kg m², our estimate (gear ratio 160 in [urdf])
_LARGE_ARMATURE, _SMALL_ARMATURE = 0.4, 0.1
_SHOULDER_LIMITS = (radians(47.0), radians(313.0))  # [urdf]
_ELBOW_LIMITS = (radians(19.0), radians(341.0))
_ZERO = (0.0, 0.0, 0.0)
_WRIST = (0.0, -0.03703, -0.06414)


def _joint(
    number: int, limits: Range | None, motor: tuple[float, float, float], *degrees: float
) -> Joint:
    """`degrees`: start and working range."""
    return Joint(f"joint_{number}", limits, *motor, *map(radians, degrees))


# The start: hand 0.40 m from the base axis, 0.28 m above the table, pointing down. The working
# range is a part of Kinova's limits in which the hand, pointing down, can be near any place where
# blocks are put. The base turns freely: its entries bound the start pose only.
JOINTS = (
    _joint(1, None, _LARGE, 0.0, -180.0, 180.0),
    _joint(2, _SHOULDER_LIMITS, _LARGE, 202.0, 180.0, 250.0),
    _joint(3, _ELBOW_LIMITS, _LARGE, 81.0, 35.0, 140.0),
    _joint(4, None, _SMALL, 199.0, 139.0, 259.0),
    _joint(5, None, _SMALL, 291.0, 231.0, 351.0),
    _joint(6, None, _SMALL, 0.0, -90.0, 90.0),
)
LINKS = (  # [urdf], [inertial]; a capsule from each joint to the next
    Link((0, 0, 0.15675), (0, pi, 0), _ZERO, (0, 0, -0.11875), 0.04, 0.7477, _LARGE_ARMATURE),
    Link(
        (0, 0.0016, -0.11875), (-pi / 2, 0, pi), _ZERO, (0, -0.410, 0), 0.04, 0.99, _LARGE_ARMATURE
    ),
    Link((0, -0.410, 0), (0, pi, 0), _ZERO, (0, 0.2073, -0.0114), 0.03, 0.6763, _LARGE_ARMATURE),
    Link((0, 0.2073, -0.0114), (-pi / 2, 0, pi), _ZERO, _WRIST, 0.03, 0.1785, _SMALL_ARMATURE),
    Link(_WRIST, (pi / 3, 0, pi), _ZERO, _WRIST, 0.03, 0.1785, _SMALL_ARMATURE),
    Link(_WRIST, (pi / 3, 0, pi), _ZERO, (0, 0, -0.08), 0.03, 0.1, _SMALL_ARMATURE),
)
BASE = Base(0.15675, 0.04, 0.46784)  # [urdf] table to joint 1; [inertial]
# One large capsule; its frame is Kinova's end effector, 0.16 m along the hand from joint 6
# ([urdf]). Mass [inertial]: hand with three fingers.
HAND = HandCapsule((0.0, 0.0, -0.16), (pi, 0.0, 0.0), 0.045, 0.03, 0.727)

JACO = ArmModel(
    "jaco",
    JOINTS,
    # fast: faster than the real arm. paper: within its speeds, slow enough for the script to
    # score about 0.6, which is "effectively perfect" in the paper.
    {"fast": (1.5,) * 6, "paper": (0.5,) * 6},
    Chain(BASE, JOINTS, LINKS, HAND),
    gripper=HAND.cup,
)
