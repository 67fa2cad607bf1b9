"""A custom arm with four joints, a table crane. The numbers are invented.

`pa_ros train --extension tests/extending/crane.py --arm crane` learns with it.
"""

from pa_ros.arena import ARMS, ArmModel, Joint

LARGE, SMALL = (2.5, 60.0, 40.0), (3.0, 15.0, 8.0)  # rad/s, N m, N m s/rad
# Name, limits, motor; start and working range. At zero the arm is straight up.
JOINTS = (
    Joint("turn", None, *LARGE, 0.0, -3.14, 3.14),
    Joint("lift", (-0.5, 2.0), *LARGE, 0.477, 0.0, 1.4),
    Joint("bend", (0.0, 2.7), *LARGE, 1.741, 0.6, 2.5),
    Joint("tilt", (-2.0, 2.0), *SMALL, 0.923, 0.2, 1.7),
)


def mjcf(attributes: str) -> str:
    """Upper arm 0.35 m, forearm 0.30 m, hand 0.15 m."""
    ranges = [f'range="{joint.lower} {joint.upper}"' for joint in JOINTS]
    return f"""
<geom type="cylinder" pos="0 0 0.1" size="0.06 0.1" {attributes}/>
<body name="turret" gravcomp="1" pos="0 0 0.3">
  <joint name="turn" axis="0 0 1" armature="0.2"/>
  <geom type="capsule" fromto="0 0 -0.1 0 0 0" size="0.05" mass="2" {attributes}/>
  <body name="upper" gravcomp="1">
    <joint name="lift" axis="0 1 0" armature="0.2" {ranges[1]}/>
    <geom type="capsule" fromto="0 0 0 0 0 0.35" size="0.04" mass="1" {attributes}/>
    <body name="fore" gravcomp="1" pos="0 0 0.35">
      <joint name="bend" axis="0 1 0" armature="0.2" {ranges[2]}/>
      <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.03" mass="0.7" {attributes}/>
      <body name="wrist" gravcomp="1" pos="0 0 0.3">
        <joint name="tilt" axis="0 1 0" armature="0.05" {ranges[3]}/>
        <geom type="capsule" fromto="0 0 0 0 0 0.08" size="0.03" mass="0.2" {attributes}/>
        <body name="hand" gravcomp="1" pos="0 0 0.15">
          <geom type="capsule" size="0.045 0.03" mass="0.5" {attributes}/>
        </body>
      </body>
    </body>
  </body>
</body>"""


ARMS.register("crane", ArmModel("crane", JOINTS, {"fast": (1.5,) * 4, "paper": (0.5,) * 4}, mjcf))
