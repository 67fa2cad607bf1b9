"""The MuJoCo model of table, arm and blocks."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from pa_ros.arena.appearance import Look
from pa_ros.arena.arms import ARMS
from pa_ros.arena.config import ArenaConfig
from pa_ros.core.errors import ConfigError

TABLE_SIDE_M = 1.6
TABLE_THICKNESS_M = 0.04
FLOOR_DEPTH_M = 0.5  # below the table top; catches blocks that fall off

# Of a texture of the table, which multiplies its color: two colors, and their fields along a side.
CHECKER, CHECKS = ((1.0, 1.0, 1.0), (0.55, 0.75, 0.9)), 8

# Contact bits: two geoms touch if the type of one meets the affinity of the other. The arm has no
# type, so it never touches itself.
SOLID, BLOCK = 1, 2
# m/s below which a pushed block falls asleep again. With MuJoCo's default, 1e-3, a block that still
# rolls would stop.
SLEEP_TOLERANCE = 1e-5
HOLD_S = 0.01  # time constant of a weld between hand and block; MuJoCo's default is 0.02
PLACES = 2  # MuJoCo's group of the geoms of places, which pictures show unless a camera hides it


def build(config: ArenaConfig, looks: Sequence[Look]) -> mujoco.MjModel:
    """Compile the arena with one free block, or one place, for each of `looks`, in that order.

    The bodies are the arm's, of which `hand` is the last, then `block0` …, so that hand and blocks
    are consecutive. Places, whose looks have no body, are only seen. Raises ConfigError if the
    arm's bodies are not as `ArmModel` describes.
    """
    try:
        model = mujoco.MjModel.from_xml_string(mjcf(config, looks))
    except ValueError as error:
        raise ConfigError(f"arm {config.arm}: expected MJCF bodies, got: {error}") from error
    _check_arm(model, config.arm, len(looks), sum(look.has_body for look in looks))
    return model


def build_textured(config: ArenaConfig) -> mujoco.MjModel:
    """The arena without blocks, with a checkered material for the table's pictures."""
    spec = mujoco.MjSpec.from_string(mjcf(config, []))
    spec.add_texture(
        name="checker", type=mujoco.mjtTexture.mjTEXTURE_2D, width=256, height=256,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER, rgb1=CHECKER[0], rgb2=CHECKER[1],
    )  # fmt: skip
    material = spec.add_material(name="checker", texrepeat=(CHECKS, CHECKS))
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "checker"
    return spec.compile()


def mjcf(config: ArenaConfig, looks: Sequence[Look]) -> str:
    """The arena as MJCF text: all that its physics depends on.

    With MuJoCo's usual `impratio`, 1, the upper blocks of a tower creep by millimetres in a minute.
    """
    blocks = "".join(_block(config, i, look) for i, look in enumerate(looks))
    return f"""
<mujoco model="programmable reaching">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{config.timestep_s}" integrator="implicitfast"
    sleep_tolerance="{SLEEP_TOLERANCE}"{' impratio="10"' * config.gripper}>
    <flag sleep="{"enable" if config.sleep else "disable"}"/>
  </option>
  <size memory="1M"/>
  <visual><global offwidth="1280" offheight="960"/></visual>
  <worldbody>
    <light pos="0 0 2.5" diffuse="0.7 0.7 0.7"/>
    <camera name="overview" pos="1.1 -1.1 1.1" xyaxes="1 1 0 -0.55 0.55 1"/>
    <camera name="above" pos="0 0 2" xyaxes="1 0 0 0 1 0"/>
    <geom name="floor" type="plane" size="3 3 0.1" pos="0 0 {-FLOOR_DEPTH_M}"
      contype="{SOLID}" conaffinity="0" rgba="0.3 0.3 0.35 1"/>
    <geom name="table" type="box" pos="0 0 {-TABLE_THICKNESS_M / 2}"
      size="{TABLE_SIDE_M / 2} {TABLE_SIDE_M / 2} {TABLE_THICKNESS_M / 2}"
      contype="{SOLID}" conaffinity="0" rgba="0.6 0.5 0.4 1"/>
    {ARMS[config.arm].mjcf(_arm_contact(config))}
    {blocks}
  </worldbody>
  <actuator>{_actuators(config)}</actuator>{_welds(config, looks)}
</mujoco>"""


def _check_arm(model: mujoco.MjModel, name: str, objects: int, free: int) -> None:
    """Raise ConfigError unless the arm has its joints, in order, and `hand` as its last body."""
    # Blocks come last in the model, each with a free joint of seven numbers.
    joints = [model.joint(i).name for i in range(model.njnt - free)]
    bodies = [model.body(i).name for i in range(model.nbody - objects)]
    if joints != list(ARMS[name].joint_names) or model.nq != len(joints) + 7 * free:
        raise ConfigError(
            f"arm {name}: expected hinges {list(ARMS[name].joint_names)}, got {joints}"
        )
    if bodies[-1] != "hand":
        raise ConfigError(f"arm {name}: expected `hand` as its last body, got {bodies[1:]}")


def _arm_contact(config: ArenaConfig) -> str:
    affinity = SOLID | BLOCK if config.arm_touches_blocks else SOLID
    return f'contype="0" conaffinity="{affinity}" rgba="0.8 0.82 0.86 1"'


def _block(config: ArenaConfig, index: int, look: Look) -> str:
    if not look.has_body:
        return f"""
<body name="block{index}" mocap="true">
  <geom name="block{index}" {look.geometry} contype="0" conaffinity="0" mass="0"
    group="{PLACES}"/>
</body>"""
    mass = config.block_mass_kg * look.density
    return f"""
<body name="block{index}" sleep="init" pos="{0.5 + 0.2 * index} 0 {look.rest_height}">
  <freejoint/>
  <geom name="block{index}" {look.geometry} mass="{mass}" contype="{BLOCK}"
    conaffinity="{SOLID | BLOCK}" condim="6" friction="{config.block_friction} 0.005 0.002"/>
</body>"""


def _welds(config: ArenaConfig, looks: Sequence[Look]) -> str:
    """What holds a block to the hand, one for each; `arena.gripper` switches them on."""
    if not config.gripper:
        return ""
    welds = [
        f'<weld name="grip{i}" body1="hand" body2="block{i}" active="false" solref="{HOLD_S} 1"/>'
        for i, look in enumerate(looks)
        if look.has_body
    ]
    return f"\n  <equality>{''.join(welds)}</equality>"


def _actuators(config: ArenaConfig) -> str:
    rows = zip(ARMS[config.arm].joints, config.joint_speed_limits, strict=True)
    return "".join(
        f'<velocity joint="{joint.name}" kv="{joint.velocity_gain}" '
        f'ctrlrange="{-speed} {speed}" forcerange="{-joint.max_torque} {joint.max_torque}"/>'
        for joint, speed in rows
    )
