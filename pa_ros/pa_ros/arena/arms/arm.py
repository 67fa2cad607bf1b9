"""An arm as data: its joints, its speeds, and its MJCF bodies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, pi

from pa_ros.core.errors import ConfigError
from pa_ros.world.controller import HEIGHTS, RADII
from pa_ros.world.world import MAX_JOINTS

Range = tuple[float, float]


@dataclass(frozen=True)
class Joint:
    """A joint that turns about its own z axis; angles in rad, speeds in rad/s."""

    name: str  # in the model and on the graph
    limits: Range | None  # of the real arm; None if it turns without limits
    max_speed: float  # of the real arm
    max_torque: float  # N m
    velocity_gain: float  # N m s/rad, of the servo that follows the commanded velocity
    start: float
    lower: float  # working range, within the limits
    upper: float


@dataclass(frozen=True)
class VacuumCup:
    """A gripper that holds the block whose top is at its tip, while it is on."""

    reach_m: float  # from the hand's frame to the tip, along the frame's z axis
    beside_m: float = 0.03  # from the tip to the middle of the block's top, sideways
    below_m: float = 0.02  # and along the axis


@dataclass(frozen=True)
class ArmModel:
    """An arm in the middle of the table, with its base at the origin.

    The start angle of the first joint is drawn from its working range in each episode.
    `mjcf(attributes)` returns MJCF elements for a worldbody: bodies with the joints, in
    order, and as the last body one named `hand`, whose frame is the frame of observations. Each
    geom of the arm needs `attributes`, which say what it touches and its color.
    """

    name: str
    joints: tuple[Joint, ...]
    # rad/s of each joint, by preset (`paper`, `fast`); the first entry is the default
    speeds: Mapping[str, tuple[float, ...]]
    mjcf: Callable[[str], str]
    block_radii_m: Range = (0.28, 0.58)  # where the hand can be near every block
    block_angles: Range = (-pi, pi)  # rad about the base
    gripper: VacuumCup | None = None
    # Where actions that are velocities of the hand move it: m from the base's axis, over the table
    hand_radii_m: Range = RADII
    hand_heights_m: Range = HEIGHTS

    def __post_init__(self) -> None:
        count = len(self.joints)
        if not 1 <= count <= MAX_JOINTS:
            raise ConfigError(f"arm {self.name}: expected 1 to {MAX_JOINTS} joints, got {count}")
        if len(set(self.joint_names)) < count:
            raise ConfigError(
                f"arm {self.name}: expected different joint names, got {self.joint_names}"
            )
        if not self.speeds:
            raise ConfigError(f"arm {self.name}: expected the speeds of a preset, got none")
        for joint in self.joints:
            low, high = joint.limits or (-inf, inf)
            if not low <= joint.lower <= joint.start <= joint.upper <= high:
                raise ConfigError(
                    f"arm {self.name}: joint {joint.name}: expected a start within its working "
                    f"range within {joint.limits} rad, got {joint.start} in "
                    f"{joint.lower} to {joint.upper}"
                )
        for preset, speeds in self.speeds.items():
            if len(speeds) != count:
                raise ConfigError(
                    f"arm {self.name}: speeds of preset {preset}: expected {count}, "
                    f"got {len(speeds)}"
                )

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joint names, in the order of commands and of the arm's features."""
        return tuple(joint.name for joint in self.joints)
