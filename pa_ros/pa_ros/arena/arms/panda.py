"""Franka Emika Panda, 7 joints, with the Franka Hand closed. Sources:

- `[fci]` Franka Control Interface Documentation, "Robot and interface specifications": Denavit–
  Hartenberg parameters (Craig's convention), limits of position, velocity and torque.
- `[urdf]` frankaemika/franka_ros, `franka_description/robots/panda_arm.xacro`: the same as joint
  origins, and capsules around the links.
- `[inertial]` google-deepmind/mujoco_menagerie, `franka_emika_panda/panda.xml`: link masses.
"""

from __future__ import annotations

from math import pi

from pa_ros.arena.arms.arm import ArmModel, Joint, Range
from pa_ros.arena.arms.chain import Base, Chain, HandCapsule, Link, Vector
from pa_ros.world.controller import RADII

# rad/s and N m [fci]; the gain is ours, as the Jaco's. Joints 1-4, then 5-7.
_LARGE = (2.175, 87.0, 80.0)
_SMALL = (2.61, 12.0, 10.0)
# kg m², reflected rotor inertia, our estimate: as the Jaco's
_LARGE_ARMATURE, _SMALL_ARMATURE = 0.4, 0.1
_TURN: Range = (-2.8973, 2.8973)  # rad [fci]

# The start: hand 0.40 m from the base axis, 0.28 m above the table, pointing down. The working
# range is a part of Franka's limits in which the hand, more or less pointing down, can be near any
# place where blocks are put. They lie so far in front of the base that the shortest way to a block
# never leads through the back, where joint 1 ends.
JOINTS = (
    Joint("panda_joint1", _TURN, *_LARGE, 0.0, -1.8, 1.8),
    Joint("panda_joint2", (-1.7628, 1.7628), *_LARGE, -0.390, -1.2, 0.75),
    Joint("panda_joint3", _TURN, *_LARGE, 0.0, -0.5, 0.5),
    Joint("panda_joint4", (-3.0718, -0.0698), *_LARGE, -2.609, -3.05, -1.6),
    Joint("panda_joint5", _TURN, *_SMALL, 0.0, -0.5, 0.5),
    Joint("panda_joint6", (-0.0175, 3.7525), *_SMALL, 2.219, 1.6, 3.0),
    Joint("panda_joint7", _TURN, *_SMALL, 0.785, -0.785, 2.355),
)
_X: Vector = (pi / 2, 0, 0)


LINKS = (  # [fci], capsules after [urdf]
    Link((0, 0, 0.333), (0, 0, 0), (0, 0, -0.19), (0, 0, -0.05), 0.06, 4.970684, _LARGE_ARMATURE),
    Link((0, 0, 0), (-pi / 2, 0, 0), (0, 0, -0.06), (0, 0, 0.06), 0.06, 0.646926, _LARGE_ARMATURE),
    Link((0, -0.316, 0), _X, (0, 0, -0.22), (0, 0, -0.07), 0.06, 3.228604, _LARGE_ARMATURE),
    Link((0.0825, 0, 0), _X, (0, 0, -0.06), (0, 0, 0.06), 0.06, 3.587895, _LARGE_ARMATURE),
    Link(
        (-0.0825, 0.384, 0),
        (-pi / 2, 0, 0),
        (0, 0, -0.31),
        (0, 0.06, -0.08),
        0.05,
        1.225946,
        _SMALL_ARMATURE,
    ),
    Link((0, 0, 0), _X, (0, 0, -0.07), (0, 0, 0.01), 0.05, 1.666555, _SMALL_ARMATURE),
    Link((0.088, 0, 0), _X, (0, 0, -0.06), (0, 0, 0.08), 0.04, 0.735522, _SMALL_ARMATURE),
)
BASE = Base(0.14, 0.07, 0.629769)
# The capsule of the Jaco's hand; the frame is the Franka Hand's tool center, 0.1034 m from the
# flange, which is 0.107 m from joint 7 [fci].
HAND = HandCapsule((0, 0, 0.107 + 0.1034), (0, 0, -pi / 4), 0.045, 0.03, 0.76)

PANDA = ArmModel(
    "panda",
    JOINTS,
    {"fast": (2.0,) * 4 + (2.5,) * 3, "paper": (0.5,) * 7},
    Chain(BASE, JOINTS, LINKS, HAND),
    block_angles=(-1.3, 1.3),
    gripper=HAND.cup,
    # Nearer to the base the elbow is at its limit, and a hand drawn in could not go up again.
    hand_radii_m=(0.26, RADII[1]),
)
