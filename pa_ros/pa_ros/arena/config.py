"""Settings of the arena: the values for any arm, the presets `paper` and `fast`, and the choice by
name.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, PositiveFloat, model_validator

from pa_ros.arena.arms import ARMS
from pa_ros.arena.designs import DESIGNS, Design, design_named
from pa_ros.core.errors import ConfigError
from pa_ros.core.registry import Registry
from pa_ros.core.settings import OneOf, Settings
from pa_ros.world.relation import RELATIONS

Joints = tuple[float, ...]  # one number for each joint of the arm
USUAL_ARM = "jaco"  # of presets that name none


class ArenaConfig(Settings):
    """Physics and timing of the task. Lengths in metres, angles in radians, times in seconds."""

    SECTION: ClassVar[str] = "arena"

    preset: str = Field("custom", description="name of these values")
    arm: Annotated[str, OneOf(lambda: ARMS)] = Field(
        USUAL_ARM, description="the arm; all sizes follow from its joints"
    )
    joint_speed_limits: tuple[PositiveFloat, ...] = Field(
        next(iter(ARMS[USUAL_ARM].speeds.values())),
        description="rad/s of each joint; commands are clamped to ±these",
    )
    thresholds: tuple[PositiveFloat, ...] = Field(
        (),
        description="of the hand, one for each relation of the design, in its unit (NEAR: m); "
        "empty: the relations' own (NEAR: the paper's 0.20)",
    )
    arm_touches_blocks: bool = Field(
        True, description="whether arm and blocks touch; it always touches the table"
    )
    hand_speed: float = Field(
        0.0,
        ge=0,
        description="m/s of the hand, if actions are velocities of the hand (radial, tangential, "
        "up); 0: actions are joint velocities",
    )
    gripper: bool = Field(
        False,
        description="whether the hand has the arm's gripper; then commands have one number more "
        "(it is on above 0), blocks are light, and arm and blocks touch",
    )
    faults: bool = Field(
        False,
        description="whether commands come late or are lost, and poses of objects are noisy or "
        "lost, as with a real arm",
    )
    control_period_s: float = Field(0.1, gt=0, description="between two actions (paper)")
    episode_steps: int = Field(
        100, ge=1, description="actions of an episode; then it is truncated (paper)"
    )
    # Constants rather than settings: no study changes them, and stored results depend on them.
    timestep_s: ClassVar[float] = 0.01  # of the physics, s
    sleep: ClassVar[bool] = True  # MuJoCo skips resting blocks, which saves time
    block_friction: ClassVar[float] = 1.0  # sliding
    block_separation_m: ClassVar[float] = 0.20  # least between two blocks' centers at the start

    # The arm's own, in the order of its joints.

    @property
    def joint_lower(self) -> Joints:
        """Lower ends of the joints' working ranges, rad."""
        return tuple(joint.lower for joint in ARMS[self.arm].joints)

    @property
    def joint_upper(self) -> Joints:
        """Upper ends of the joints' working ranges, rad."""
        return tuple(joint.upper for joint in ARMS[self.arm].joints)

    @property
    def command_limits(self) -> tuple[float, ...]:
        """The greatest size of each number of a command: rad/s of the joints; 1 of the gripper."""
        return (*self.joint_speed_limits, *[1.0] * self.gripper)

    @property
    def block_mass_kg(self) -> float:
        """Mass of each block: less where a gripper has to lift them."""
        return 0.2 if self.gripper else 1.0

    @property
    def substeps(self) -> int:
        """Physics steps of one control period."""
        return round(self.control_period_s / self.timestep_s)

    @property
    def control_period_ns(self) -> int:
        """The control period in nanoseconds."""
        return round(self.control_period_s * 1e9)

    @property
    def joints(self) -> int:
        """Number of joints of the arm."""
        return len(ARMS[self.arm].joints)

    @model_validator(mode="before")
    @classmethod
    def _use_arm_defaults(cls, values: Any) -> Any:
        """Speeds that are not given are the arm's first."""
        if isinstance(values, Mapping) and (arm := values.get("arm", USUAL_ARM)) in ARMS:
            return {"joint_speed_limits": next(iter(ARMS[arm].speeds.values())), **values}
        return values

    @model_validator(mode="after")
    def _check_joints_and_period(self) -> Self:
        if len(self.joint_speed_limits) != self.joints:
            raise ValueError(
                f"joint_speed_limits: expected {self.joints} numbers, the joints of {self.arm}, "
                f"got {len(self.joint_speed_limits)}: {self.joint_speed_limits}"
            )
        if self.gripper and not (ARMS[self.arm].gripper and self.arm_touches_blocks):
            raise ValueError(
                f"gripper: expected an arm with one that touches blocks, got {self.arm}"
            )
        if abs(self.substeps * self.timestep_s - self.control_period_s) > 1e-9:
            raise ValueError(
                f"control_period_s: expected a multiple of timestep_s = {self.timestep_s}, "
                f"got {self.control_period_s}"
            )
        return self


Preset = tuple[str, Mapping[str, Any]]
"""Which of the arm's speeds a preset has, and what else differs; with "arm", it is of that arm."""

# Each preset also sets the arm's joint speeds. In `fast` the arm passes through blocks (but touches
# the table); learning then needs the fewest frames. In `paper` it pushes them.
#
# In `robot` the fast arm has the faults of a real one (`faults.py`).
#
# The presets `push…` are for programs that move blocks: the fast arm or the slow one, which touches
# blocks, with actions that are velocities of the hand, or of the joints. The presets `hold…` add
# the gripper.
_VALUES: dict[str, Preset] = {
    "paper": ("paper", {}),
    "fast": ("fast", {"arm_touches_blocks": False}),
    "robot": ("fast", {"arm_touches_blocks": False, "faults": True}),
    "push": ("fast", {"hand_speed": 0.5}),
    "push-joints": ("fast", {}),
    "push-slow": ("paper", {"hand_speed": 0.25}),
    "hold": ("fast", {"hand_speed": 0.5, "gripper": True}),
    # Half as fast and half as often, so that a step is as long.
    "hold-slow": ("paper", {"hand_speed": 0.25, "control_period_s": 0.2, "gripper": True}),
}
PRESET_VALUES: Registry[Preset] = Registry("preset")
"""By name; those above, and those of extensions."""
for _name, _value in _VALUES.items():
    PRESET_VALUES.register(_name, _value)


def preset_named(name: str, arm: str = "") -> ArenaConfig:
    """Look up a preset for an arm, by default its own; ConfigError lists the known presets."""
    known = _presets(arm)
    if name not in known:
        of_arm = f" of {arm}" if arm else ""
        raise ConfigError(f"arena: expected a preset of {sorted(known)}{of_arm}, got {name!r}")
    return known[name]


def preset_for(design: Design, name: str = "", arm: str = "") -> ArenaConfig:
    """A preset in which the design's programs can be executed; by default the design's own.

    Raises ConfigError for an unknown one, or for one that does not fit.
    """
    config = preset_named(name or design.preset, arm)
    check_fits(config, design)
    return config


def check_fits(config: ArenaConfig, design: Design) -> None:
    """Raise ConfigError, with the presets that fit, unless the arm can execute the programs."""
    if design.skill.touches_blocks and not config.arm_touches_blocks:
        fitting = [name for name, one in _presets(config.arm).items() if one.arm_touches_blocks]
        raise ConfigError(
            f"preset: expected one of {fitting} for {design.name}, whose blocks the arm must "
            f"touch, got {config.preset!r}"
        )
    if design.skill.holds_blocks and not config.gripper:
        fitting = [name for name, one in _presets(config.arm).items() if one.gripper]
        raise ConfigError(
            f"preset: expected one of {fitting} for {design.name}, whose blocks the arm must "
            f"hold, got {config.preset!r}"
        )


def _presets(arm: str = "") -> dict[str, ArenaConfig]:
    """The presets that an arm has speeds for; without an arm all presets, each with its own."""
    found = {}
    for name in PRESET_VALUES:
        of_arm, values = PRESET_VALUES[name]
        own = values.get("arm", arm or USUAL_ARM)
        if (speeds := ARMS[own].speeds.get(of_arm)) is None or arm not in ("", own):
            continue
        if ARMS[own].gripper or not values.get("gripper"):
            given = {"arm": own, **values}
            found[name] = ArenaConfig(preset=name, joint_speed_limits=speeds, **given)
    return found


PRESETS = _presets()
"""All presets, each with its own arm."""


class ArenaChoice(Settings):
    """A design, an arm, a preset and a reward, by name."""

    design: Annotated[str, OneOf(lambda: DESIGNS)] = Field(
        "2-L", description="which blocks there are, and which programs are held out"
    )
    relations: tuple[Annotated[str, OneOf(lambda: RELATIONS)], ...] = Field(
        (), description="relations of the programs; empty: the design's own (in the paper NEAR)"
    )
    arm: Annotated[str, OneOf(lambda: ARMS, or_empty=True)] = Field(
        "", description="the arm in the middle of the table; empty: the preset's own, mostly jaco"
    )
    preset: Annotated[str, OneOf(lambda: PRESET_VALUES, or_empty=True)] = Field(
        "",
        description="the arm's speed, whether it touches blocks, and what actions are; empty: the "
        "design's own",
    )
    reward: str = Field("sparse", description="a name, or JSON of name and parameters")

    def design_of(self) -> Design:
        """The design, with the chosen relations."""
        design = design_named(self.design)
        return design.with_relations(*self.relations) if self.relations else design

    def arena_config(self) -> ArenaConfig:
        """The arena's preset; ConfigError if the arm does not have it, or it does not fit."""
        return preset_for(self.design_of(), self.preset, self.arm)
