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
from pa_ros.core.settings import OneOf, Settings
from pa_ros.world.relations import RELATIONS

Joints = tuple[float, ...]  # one number for each joint of the arm
# `_use_arm_defaults` replaces these for other arms.
_JACO: dict[str, Any] = ARMS["jaco"].settings


class ArenaConfig(Settings):
    """Physics and timing of the task. Lengths in metres, angles in radians, times in seconds."""

    SECTION: ClassVar[str] = "arena"

    preset: str = Field("custom", description="what these values are called")
    arm: Annotated[str, OneOf(lambda: ARMS)] = Field(
        "jaco", description="its joints are what the other values, and all sizes, are of"
    )
    joint_speed_limits: tuple[PositiveFloat, ...] = Field(
        _JACO["joint_speed_limits"],
        description="rad/s of each joint; commands are clamped to ±these",
    )
    thresholds: tuple[PositiveFloat, ...] = Field(
        (),
        description="of the design's relations, in their order and units (NEAR: m); none: their "
        "own (NEAR: the paper's 0.20)",
    )
    arm_touches_blocks: bool = Field(
        True, description="the arm touches the table in any case, itself never"
    )
    start_pose: Joints = Field(
        _JACO["start_pose"],
        description="rad; the base angle is drawn from its range in each episode",
    )
    joint_lower: Joints = Field(
        _JACO["joint_lower"], description="rad, working range of each joint"
    )
    joint_upper: Joints = Field(
        _JACO["joint_upper"], description="rad, working range of each joint"
    )
    timestep_s: float = Field(0.01, gt=0, description="of the physics")
    control_period_s: float = Field(0.1, gt=0, description="between two actions (paper)")
    episode_steps: int = Field(
        100, ge=1, description="actions of an episode; then it is truncated (paper)"
    )
    block_mass_kg: float = Field(1.0, gt=0, description="of each block")
    block_friction: float = Field(1.0, gt=0, description="sliding")
    block_radii_m: tuple[PositiveFloat, PositiveFloat] = Field(
        _JACO["block_radii_m"],
        description="least and greatest, from the base axis, where blocks start",
    )
    block_angles: tuple[float, float] = Field(
        _JACO["block_angles"], description="rad, least and greatest, about the base axis"
    )
    block_separation_m: float = Field(
        0.20, gt=0, description="least between two blocks' centers at the start"
    )
    sleep: bool = Field(True, description="MuJoCo's sleeping of resting blocks")

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
        """Values that are not given are the defaults of the arm."""
        known = isinstance(values, Mapping) and values.get("arm", "jaco") in ARMS
        return {**ARMS[values.get("arm", "jaco")].settings, **values} if known else values

    @model_validator(mode="after")
    def _check_ranges(self) -> Self:
        for name in ("block_radii_m", "block_angles"):
            lower, upper = getattr(self, name)
            if not lower < upper:
                raise ValueError(f"{name}: expected the first below the second, got {lower, upper}")
        return self

    @model_validator(mode="after")
    def _check_joints(self) -> Self:
        arm = ARMS[self.arm]
        for name in ("joint_speed_limits", "start_pose", "joint_lower", "joint_upper"):
            if len(values := getattr(self, name)) != len(arm.joints):
                raise ValueError(
                    f"{name}: expected {len(arm.joints)} numbers, the joints of {self.arm}, "
                    f"got {len(values)}: {values}"
                )
        rows = zip(arm.joints, self.joint_lower, self.start_pose, self.joint_upper, strict=True)
        for joint, low, start, high in rows:
            if not low <= start <= high:
                raise ValueError(
                    f"start_pose: {joint.name}: expected {low} to {high} rad, got {start}"
                )
            if joint.limits and not joint.limits[0] <= low < high <= joint.limits[1]:
                raise ValueError(
                    f"joint_lower: {joint.name}: expected a range within {self.arm}'s "
                    f"{joint.limits} rad, got {low} to {high}"
                )
        return self

    @model_validator(mode="after")
    def _check_period(self) -> Self:
        if abs(self.substeps * self.timestep_s - self.control_period_s) > 1e-9:
            raise ValueError(
                f"control_period_s: expected a multiple of timestep_s = {self.timestep_s}, "
                f"got {self.control_period_s}"
            )
        return self


# The arm adds its speeds to each preset. In `fast` the arm passes through blocks (but touches the
# table); learning then needs the fewest frames. In `paper` it pushes them.
_VALUES: dict[str, dict[str, Any]] = {"paper": {}, "fast": {"arm_touches_blocks": False}}


def preset_named(name: str, arm: str = "jaco") -> ArenaConfig:
    """Look up a preset for an arm; ConfigError lists the known presets."""
    speeds = ARMS[arm].speeds
    known = [preset for preset in _VALUES if preset in speeds]
    if name not in known:
        raise ConfigError(f"arena: expected a preset of {sorted(known)} of {arm}, got {name!r}")
    return ArenaConfig(preset=name, arm=arm, joint_speed_limits=speeds[name], **_VALUES[name])


PRESETS = {name: preset_named(name) for name in _VALUES}
"""The presets of the Jaco."""


class ArenaChoice(Settings):
    """A design, an arm and a preset, by name."""

    design: Annotated[str, OneOf(lambda: DESIGNS)] = Field(
        "2-L", description="which blocks there are, and which programs are held out"
    )
    relations: tuple[Annotated[str, OneOf(lambda: RELATIONS)], ...] = Field(
        (), description="that programs ask for; none: the design's own, which is NEAR in the paper"
    )
    arm: Annotated[str, OneOf(lambda: ARMS)] = Field("jaco", description="in the middle")
    preset: Annotated[str, OneOf(lambda: PRESETS)] = Field(
        "fast", description="the arm's speed, and whether it touches blocks"
    )

    def design_of(self) -> Design:
        """The design, with the chosen relations."""
        design = design_named(self.design)
        return design.with_relations(*self.relations) if self.relations else design

    def arena_config(self) -> ArenaConfig:
        """The preset of the arm; ConfigError if the arm has no such preset."""
        return preset_named(self.preset, self.arm)
