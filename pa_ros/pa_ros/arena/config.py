"""Parameters of the arena and the presets `paper` and `fast`."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, radians

from pa_ros.arena.constants import LINKS
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import JOINTS

Joints = tuple[float, ...]  # one number for each of the 6 joints


def _degrees(*values: float) -> Joints:
    return tuple(radians(value) for value in values)


# Hand 0.40 m from the base axis, 0.28 m above the table, pointing down.
START_POSE = _degrees(0.0, 202.0, 81.0, 199.0, 291.0, 0.0)
# A part of Kinova's limits in which the hand, pointing down, can be near any place where blocks
# are put. The base turns freely: its entries bound the start pose only.
LOWER = _degrees(-180.0, 180.0, 35.0, 139.0, 231.0, -90.0)
UPPER = _degrees(180.0, 250.0, 140.0, 259.0, 351.0, 90.0)


@dataclass(frozen=True, kw_only=True)
class ArenaConfig:
    """The task's physics and timing. Lengths in metres, angles in radians, times in seconds."""

    preset: str = "custom"
    joint_speed_limits: Joints = (1.5,) * JOINTS  # rad/s; commands are clamped to ±these
    near_threshold_m: float = 0.20  # hand frame's origin to block center, paper section 3
    arm_touches_blocks: bool = True  # the arm touches the table in any case, itself never
    start_pose: Joints = START_POSE  # the base angle is drawn uniformly in each episode
    joint_lower: Joints = LOWER
    joint_upper: Joints = UPPER
    timestep_s: float = 0.01
    control_period_s: float = 0.1  # paper, appendix
    episode_steps: int = 100  # actions of an episode; then it is truncated (paper, appendix)
    block_mass_kg: float = 1.0
    block_friction: float = 1.0  # sliding
    block_radii_m: tuple[float, float] = (0.28, 0.58)  # from the base axis, where blocks start
    block_separation_m: float = 0.20  # between block centers at the start
    sleep: bool = True  # MuJoCo's sleeping of resting blocks

    def __post_init__(self) -> None:
        for name in ("joint_speed_limits", "start_pose", "joint_lower", "joint_upper"):
            values = getattr(self, name)
            if len(values) != JOINTS or not all(map(isfinite, values)):
                raise ConfigError(f"arena: {name}: expected {JOINTS} finite numbers, got {values}")
        for name in (
            "near_threshold_m",
            "timestep_s",
            "control_period_s",
            "episode_steps",
            "block_mass_kg",
            "block_friction",
            "block_separation_m",
        ):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise ConfigError(f"arena: {name}: expected a positive number, got {value}")
        self._check_speeds()
        self._check_range()
        self._check_ratio()

    @property
    def substeps(self) -> int:
        """Physics steps of one control period."""
        return round(self.control_period_s / self.timestep_s)

    @property
    def control_period_ns(self) -> int:
        return round(self.control_period_s * 1e9)

    def _check_speeds(self) -> None:
        if min(self.joint_speed_limits) <= 0:
            raise ConfigError(
                f"arena: joint_speed_limits: expected positive, got {self.joint_speed_limits}"
            )

    def _check_range(self) -> None:
        lower, upper = self.block_radii_m
        if not 0 < lower < upper:
            raise ConfigError(f"arena: block_radii_m: expected 0 < a < b, got {self.block_radii_m}")
        rows = zip(self.joint_lower, self.start_pose, self.joint_upper, LINKS, strict=True)
        for joint, (low, start, high, link) in enumerate(rows, start=1):
            if not low <= start <= high:
                raise ConfigError(
                    f"arena: joint {joint}: start {start} is outside [{low}, {high}] rad"
                )
            if link.limits and not link.limits[0] <= low < high <= link.limits[1]:
                raise ConfigError(
                    f"arena: joint {joint}: [{low}, {high}] exceeds Kinova's {link.limits} rad"
                )

    def _check_ratio(self) -> None:
        if abs(self.substeps * self.timestep_s - self.control_period_s) > 1e-9:
            raise ConfigError(
                "arena: expected control_period_s to be a multiple of timestep_s, got "
                f"{self.control_period_s} and {self.timestep_s}"
            )


PRESETS = {
    # Within the real Jaco's speeds (36°/s = 0.628 rad/s), slow enough for the script to score
    # about 0.6, which is "effectively perfect" in the paper. The arm pushes blocks.
    "paper": ArenaConfig(preset="paper", joint_speed_limits=(0.5,) * JOINTS),
    # Faster than the real arm, and the arm passes through blocks (it still touches the table):
    # the setting in which learning takes the fewest frames.
    "fast": ArenaConfig(
        preset="fast", joint_speed_limits=(1.5,) * JOINTS, arm_touches_blocks=False
    ),
}


def preset_named(name: str) -> ArenaConfig:
    """Look up a preset; ConfigError names the known ones."""
    if name not in PRESETS:
        raise ConfigError(f"arena: expected a preset of {sorted(PRESETS)}, got {name!r}")
    return PRESETS[name]
