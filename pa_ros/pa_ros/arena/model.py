"""MuJoCo model of table, arm and blocks, built from the constants."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from pa_ros.arena import constants as c
from pa_ros.arena.appearance import Look
from pa_ros.arena.arms import ARMS
from pa_ros.arena.arms.arm import Arm
from pa_ros.arena.config import ArenaConfig
from pa_ros.core.errors import ConfigError

# Contact bits: two geoms touch if one's type meets the other's affinity. The arm has no type, so
# it never touches itself.
SOLID, BLOCK = 1, 2
# m/s below which a pushed block may fall asleep again. MuJoCo's default, 1e-3, stops a block that
# still rolls; this changes no reward in docs/arena.md's comparison and costs no speed.
SLEEP_TOLERANCE = 1e-5


def build(config: ArenaConfig, looks: Sequence[Look]) -> mujoco.MjModel:
    """Compile the arena with one free block per entry of `looks`, in that order.

    Bodies are the arm's, the last one `hand`, then `block0` …, so that the hand and the blocks are
    consecutive. Raises ConfigError for an arm that isn't what `Arm` says.
    """
    try:
        model = mujoco.MjModel.from_xml_string(mjcf(config, looks))
    except ValueError as error:
        raise ConfigError(f"arm {config.arm}: expected MJCF bodies, got: {error}") from error
    _check(model, ARMS[config.arm], len(looks))
    return model


def mjcf(config: ArenaConfig, looks: Sequence[Look]) -> str:
    """The arena as text: all that its physics depends on. Raises ConfigError as `Arm.bodies`."""
    blocks = "".join(_block(config, i, look) for i, look in enumerate(looks))
    return f"""
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
    <camera name="above" pos="0 0 2" xyaxes="1 0 0 0 1 0"/>
    <geom name="floor" type="plane" size="3 3 0.1" pos="0 0 {-c.FLOOR_DEPTH_M}"
      contype="{SOLID}" conaffinity="0" rgba="0.3 0.3 0.35 1"/>
    <geom name="table" type="box" pos="0 0 {-c.TABLE_THICKNESS_M / 2}"
      size="{c.TABLE_SIDE_M / 2} {c.TABLE_SIDE_M / 2} {c.TABLE_THICKNESS_M / 2}"
      contype="{SOLID}" conaffinity="0" rgba="0.6 0.5 0.4 1"/>
    {ARMS[config.arm].bodies(config, _arm_contact(config))}
    {blocks}
  </worldbody>
  <actuator>{_actuators(config)}</actuator>
</mujoco>"""


def _check(model: mujoco.MjModel, arm: Arm, blocks: int) -> None:
    """The arm has its joints, in order, each of one number, and the hand as its last body."""
    joints = [model.joint(i).name for i in range(model.njnt - blocks)]
    bodies = [model.body(i).name for i in range(model.nbody - blocks)]
    if joints != list(arm.joint_names) or model.nq != len(joints) + 7 * blocks:
        raise ConfigError(
            f"arm {arm.name}: expected hinges {list(arm.joint_names)} in its model, got {joints}"
        )
    if bodies[-1] != "hand":
        raise ConfigError(f"arm {arm.name}: expected `hand` as its last body, got {bodies[1:]}")


def _arm_contact(config: ArenaConfig) -> str:
    affinity = SOLID | BLOCK if config.arm_touches_blocks else SOLID
    return f'contype="0" conaffinity="{affinity}" rgba="0.8 0.82 0.86 1"'


def _block(config: ArenaConfig, index: int, look: Look) -> str:
    mass = config.block_mass_kg * look.density
    return f"""
<body name="block{index}" sleep="init" pos="{0.5 + 0.2 * index} 0 {look.rest_height}">
  <freejoint/>
  <geom name="block{index}" {look.geometry} mass="{mass}" contype="{BLOCK}"
    conaffinity="{SOLID | BLOCK}" condim="6" friction="{config.block_friction} 0.005 0.002"/>
</body>"""


def _actuators(config: ArenaConfig) -> str:
    rows = zip(ARMS[config.arm].joints, config.joint_speed_limits, strict=True)
    return "".join(
        f'<velocity joint="{joint.name}" kv="{joint.velocity_gain}" '
        f'ctrlrange="{-speed} {speed}" forcerange="{-joint.max_torque} {joint.max_torque}"/>'
        for joint, speed in rows
    )
