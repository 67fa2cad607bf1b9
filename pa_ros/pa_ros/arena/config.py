"""Parameters of the arena and the presets `paper` and `fast`."""

from __future__ import annotations

from math import radians
from typing import Any, ClassVar

from pydantic import Field, PositiveFloat, model_validator
from typing_extensions import Self

from pa_ros.arena.constants import LINKS
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import JOINTS
from pa_ros.core.settings import Settings

Joints = tuple[float, float, float, float, float, float]
Speeds = tuple[
    PositiveFloat, PositiveFloat, PositiveFloat, PositiveFloat, PositiveFloat, PositiveFloat
]


def _degrees(a: float, b: float, c: float, d: float, e: float, f: float) -> Joints:
    return radians(a), radians(b), radians(c), radians(d), radians(e), radians(f)


# Hand 0.40 m from the base axis, 0.28 m above the table, pointing down.
START_POSE = _degrees(0.0, 202.0, 81.0, 199.0, 291.0, 0.0)
# A part of Kinova's limits in which the hand, pointing down, can be near any place where blocks
# are put. The base turns freely: its entries bound the start pose only.
LOWER = _degrees(-180.0, 180.0, 35.0, 139.0, 231.0, -90.0)
UPPER = _degrees(180.0, 250.0, 140.0, 259.0, 351.0, 90.0)


class ArenaConfig(Settings):
    """The task's physics and timing. Lengths in metres, angles in radians, times in seconds."""

    SECTION: ClassVar[str] = "arena"

    preset: str = Field("custom", description="what these values are called")
    joint_speed_limits: Speeds = Field(
        (1.5, 1.5, 1.5, 1.5, 1.5, 1.5),
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
        START_POSE, description="rad; the base angle is drawn uniformly in each episode"
    )
    joint_lower: Joints = Field(LOWER, description="rad, working range of each joint")
    joint_upper: Joints = Field(UPPER, description="rad, working range of each joint")
    timestep_s: float = Field(0.01, gt=0, description="of the physics")
    control_period_s: float = Field(0.1, gt=0, description="between two actions (paper)")
    episode_steps: int = Field(
        100, ge=1, description="actions of an episode; then it is truncated (paper)"
    )
    block_mass_kg: float = Field(1.0, gt=0, description="of each block")
    block_friction: float = Field(1.0, gt=0, description="sliding")
    block_radii_m: tuple[PositiveFloat, PositiveFloat] = Field(
        (0.28, 0.58), description="least and greatest, from the base axis, where blocks start"
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
        return round(self.control_period_s * 1e9)

    @model_validator(mode="after")
    def _ranges_hold(self) -> Self:
        lower, upper = self.block_radii_m
        if not lower < upper:
            raise ValueError(
                f"block_radii_m: expected the first below the second, got {lower, upper}"
            )
        rows = zip(self.joint_lower, self.start_pose, self.joint_upper, LINKS, strict=True)
        for joint, (low, start, high, link) in enumerate(rows, start=1):
            if not low <= start <= high:
                raise ValueError(
                    f"start_pose: joint {joint}: expected {low} to {high} rad, got {start}"
                )
            if link.limits and not link.limits[0] <= low < high <= link.limits[1]:
                raise ValueError(
                    f"joint_lower: joint {joint}: expected a range within Kinova's {link.limits} "
                    f"rad, got {low} to {high}"
                )
        return self

    @model_validator(mode="after")
    def _whole_steps(self) -> Self:
        if abs(self.substeps * self.timestep_s - self.control_period_s) > 1e-9:
            raise ValueError(
                f"control_period_s: expected a multiple of timestep_s = {self.timestep_s}, "
                f"got {self.control_period_s}"
            )
        return self


_VALUES: dict[str, dict[str, Any]] = {
    # Within the real Jaco's speeds (36°/s = 0.628 rad/s), slow enough for the script to score
    # about 0.6, which is "effectively perfect" in the paper. The arm pushes blocks.
    "paper": {"joint_speed_limits": (0.5,) * JOINTS},
    # Faster than the real arm, and the arm passes through blocks (it still touches the table):
    # the setting in which learning takes the fewest frames.
    "fast": {"joint_speed_limits": (1.5,) * JOINTS, "arm_touches_blocks": False},
}
PRESETS = {name: ArenaConfig(preset=name, **values) for name, values in _VALUES.items()}


def preset_named(name: str) -> ArenaConfig:
    """Look up a preset; ConfigError names the known ones."""
    if name not in PRESETS:
        raise ConfigError(f"arena: expected a preset of {sorted(PRESETS)}, got {name!r}")
    return PRESETS[name]
