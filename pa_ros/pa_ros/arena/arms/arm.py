"""What an arm is: the facts that the arena, its settings and its references ask for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING

from pa_ros.arena.constants import PRESETS
from pa_ros.core.errors import ConfigError
from pa_ros.world.world import MAX_JOINTS

if TYPE_CHECKING:
    from pa_ros.arena.config import ArenaConfig

Range = tuple[float, float]


@dataclass(frozen=True)
class Joint:
    """One joint, turning about its own z; angles in rad, speeds in rad/s."""

    name: str  # in the model and on the graph
    limits: Range | None  # of the real arm; None: it turns without end
    max_speed: float  # of the real arm
    max_torque: float  # N m
    velocity_gain: float  # N m s/rad, of the servo that follows the commanded velocity
    start: float
    lower: float  # working range, within the limits
    upper: float


@dataclass(frozen=True)
class Arm:
    """An arm in the middle of the table, its base in the origin.

    The first joint's start is drawn uniformly from its working range in each episode. `mjcf` gives
    MJCF elements for a worldbody: a body with each of the joints, in order, and as the last body
    one named `hand`, whose frame is that of Ω. Its second argument are attributes that each of the
    arm's geoms needs: what it touches, and its color.
    """

    name: str
    joints: tuple[Joint, ...]
    # rad/s of each joint, by the arena's preset; the first one's where none is asked for
    speeds: Mapping[str, tuple[float, ...]]
    mjcf: Callable[[ArenaConfig, str], str]
    block_radii_m: Range = (0.28, 0.58)  # where the hand can be near any block
    block_angles: Range = (-pi, pi)  # rad about the base

    def __post_init__(self) -> None:
        count = len(self.joints)
        if not 1 <= count <= MAX_JOINTS:
            raise ConfigError(f"arm {self.name}: expected 1 to {MAX_JOINTS} joints, got {count}")
        if len(set(self.joint_names)) < count:
            raise ConfigError(
                f"arm {self.name}: expected different joint names, got {self.joint_names}"
            )
        if not self.speeds or not set(self.speeds) <= set(PRESETS):
            raise ConfigError(
                f"arm {self.name}: speeds: expected those of some of {list(PRESETS)}, "
                f"got {list(self.speeds)}"
            )
        for preset, speeds in self.speeds.items():
            if len(speeds) != count:
                raise ConfigError(
                    f"arm {self.name}: speeds of preset {preset}: expected {count}, "
                    f"got {len(speeds)}"
                )

    @property
    def joint_names(self) -> tuple[str, ...]:
        """In the order of commands and of the arm's features."""
        return tuple(joint.name for joint in self.joints)

    def bodies(self, config: ArenaConfig, attributes: str) -> str:
        """What `mjcf` gives; ConfigError, with the arm's name, if it raises or that is no text."""
        try:
            text = self.mjcf(config, attributes)
        except Exception as error:  # whatever code of others raises
            raise ConfigError(
                f"arm {self.name}: expected MJCF bodies, got {type(error).__name__}: {error}"
            ) from error
        if not isinstance(text, str):
            raise ConfigError(f"arm {self.name}: expected MJCF bodies as text, got {text!r}")
        return text

    @property
    def settings(self) -> dict[str, tuple[float, ...]]:
        """What `ArenaConfig` takes from the arm where it is not told otherwise."""
        return {
            "joint_speed_limits": next(iter(self.speeds.values())),
            "start_pose": tuple(joint.start for joint in self.joints),
            "joint_lower": tuple(joint.lower for joint in self.joints),
            "joint_upper": tuple(joint.upper for joint in self.joints),
            "block_radii_m": self.block_radii_m,
            "block_angles": self.block_angles,
        }
