"""What robot.yaml says about a robot and its table (docs/robot.md). Without ROS."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from pa_ros.arena import ArenaChoice, Kind
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float64
from pa_ros.core.settings import Settings
from pa_ros.core.yaml_text import read_yaml
from pa_ros.wire.step import MAX_OBJECTS
from pa_ros.world.poses import IDENTITY

Entry = TypeVar("Entry", bound=Settings)
Offset = tuple[float, ...]  # empty, a position (m), or a position and a quaternion xyzw
Place = tuple[float, float, float]
# As tf2 does, names of frames drop the slash that ROS 1 put before them.
Frame = Annotated[str, AfterValidator(lambda name: name.removeprefix("/"))]
HAND = "hand"  # its name among the objects
FARTHEST = 100.0  # m, of an offset


class DriverJoint(Settings):
    """A joint of the driver. The agent's angle is sign × the driver's + offset."""

    name: str = Field(description="in joint_states and in commands")
    sign: Literal[1, -1] = Field(1, description="-1 if the driver counts the other way")
    offset: float = Field(0.0, ge=-100, le=100, description="rad")


class Thing(Settings):
    """An object on the table: its words, and what measures its pose."""

    words: tuple[str, ...] = Field(description="one of each property group")
    frame: Frame = Field("", description="tf frame of the object or of the tag on it")
    detection: str = Field("", description="class in a vision_msgs/Detection3DArray")
    topic: str = Field("", description="of geometry_msgs/PoseStamped")
    offset: Offset = Field((), description="pose of the object's center in what is measured")

    @model_validator(mode="after")
    def _is_measured_once(self) -> Self:
        if sum(map(bool, (self.frame, self.detection, self.topic))) != 1:
            raise ValueError("expected exactly one of frame, detection and topic")
        pose_of(self.offset, "offset")
        return self

    @property
    def source(self) -> str:
        """The frame that measures it: one of tf, or one beside it (`measured_frame`)."""
        return self.frame or measured_frame(self.detection or self.topic)


class Workspace(Settings):
    """The box that the hand does not leave, in the base's frame."""

    lower: Place = Field(description="m")
    upper: Place = Field(description="m")

    @model_validator(mode="after")
    def _has_room(self) -> Self:
        if not all(low < high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"lower: expected less than upper {self.upper}, got {self.lower}")
        return self


class GripperSettings(Settings):
    """How a gripper is driven, and what says whether it holds something."""

    valve: str = Field("", description="topic of std_msgs/Bool: true while a vacuum cup is on")
    fingers: str = Field("", description="action of control_msgs/GripperCommand")
    open_m: float = Field(0.08, ge=0, le=1, description="gap of the fingers when they let go")
    closed_m: float = Field(
        0.0, ge=0, le=1, description="gap that they close to; a block stops them"
    )
    max_effort: float = Field(20.0, ge=0, le=1e3, description="N, of the fingers")
    holds: str = Field("", description="topic of std_msgs/Bool: true while it holds something")
    joint: str = Field("", description="finger in joint_states, in place of such a topic")
    holds_above: float = Field(0.01, ge=0, le=1, description="where the finger stops on a block; m")
    when_lost: Literal["keep", "release"] = Field(
        "keep", description="what the gripper does while the arm holds because something is lost"
    )

    @model_validator(mode="after")
    def _is_driven_and_heard_once(self) -> Self:
        for names in (("valve", "fingers"), ("holds", "joint")):
            if sum(bool(getattr(self, name)) for name in names) != 1:
                raise ValueError(f"expected exactly one of {names[0]} and {names[1]}")
        return self


class LessonSettings(Settings):
    """How an arm learns on its own table, without being reset."""

    programs: tuple[str, ...] = Field(
        (), description="training programs; empty: the design's, which hold out some"
    )
    blocks: int = Field(
        0, ge=0, lt=MAX_OBJECTS, description="objects on the table at once; 0: all of the file"
    )
    episode_s: float = Field(10.0, gt=0, le=1e4, description="time for one program")
    scatter_every_min: float = Field(
        10.0, ge=0, le=1e4, description="after which a person scatters the blocks; 0: never"
    )
    seed: int = Field(0, ge=0, description="of the order of programs")


class RobotSettings(ArenaChoice):
    """The settings of robot.yaml but for its joints and objects."""

    dry_run: bool = Field(True, description="only show what would be sent, under dry_run/")
    control: Literal["velocity", "joint_trajectory", "joint_jog"] = Field(
        "velocity", description="what the controller takes"
    )
    base_frame: Frame = Field(description="tf frame of the arm's base, on the table, z up")
    hand_frame: Frame = Field(description="tf frame of the hand")
    hand_offset: Offset = Field((), description="pose of the agent's hand in hand_frame")
    workspace: Workspace
    speed_scale: float = Field(0.3, gt=0, le=1, description="of the speeds the agent learned with")
    max_acceleration: float = Field(2.0, ge=0, le=1e3, description="rad/s² per joint; 0: no limit")
    relay: bool = Field(
        True, description="stop the arm if robot_node dies; false: its controller does so"
    )
    gripper: GripperSettings | None = Field(None, description="of an arm that holds things")
    arm_delay_s: float = Field(
        0.0, ge=0, le=0.5, description="from a command to the motion; agents see the arm as it "
        "will be then",
    )  # fmt: skip
    learning: LessonSettings | None = Field(None, description="where the arm is to learn")
    objects_timeout_s: float = Field(
        0.5, gt=0, le=60, description="greatest age of an object's pose"
    )

    @model_validator(mode="after")
    def _has_a_hand(self) -> Self:
        pose_of(self.hand_offset, "hand_offset")
        return self


@dataclass(frozen=True)
class Robot:
    """A whole robot.yaml."""

    settings: RobotSettings
    joints: tuple[DriverJoint, ...]  # in the order of the agent's arm
    objects: dict[str, Thing]  # by name, in the order of the observation's rows
    kinds: tuple[Kind, ...]  # of the objects


def measured_frame(source: str) -> str:
    """The name under which poses from a detection's class or a topic are kept beside tf's."""
    return f"measured:{source}"


def load_robot(path: Path) -> Robot:
    """Read a robot.yaml. Raises ConfigError, with the file's name, for the first fault."""
    try:
        return read_robot(read_yaml(path.read_text()))
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    except (OSError, ValueError) as error:
        told = " ".join(str(error).split())
        raise ConfigError(f"{path}: expected a file robot.yaml, got: {told}") from None


def read_robot(values: Any) -> Robot:
    """The robot of a robot.yaml's values. Raises ConfigError for the first fault."""
    whole = _mapping("robot.yaml", values)
    joints, objects = whole.pop("joints", None), whole.pop("objects", None)
    settings = RobotSettings(**whole)
    config = settings.arena_config()
    if config.gripper != (settings.gripper is not None):
        told = "how it is driven" if config.gripper else "none"
        raise ConfigError(f"gripper: expected {told}, as the preset {config.preset} has it")
    expected = config.joints
    if not isinstance(joints, list) or len(joints) != expected:
        raise ConfigError(f"joints: expected a list of {expected} for {config.arm}, got {joints}")
    read = tuple(_entry(DriverJoint, f"joints[{i}]", one) for i, one in enumerate(joints))
    things = {name: _entry(Thing, f"objects.{name}", one)
              for name, one in _mapping("objects", objects).items()}  # fmt: skip
    if not len(things) < MAX_OBJECTS:
        raise ConfigError(f"objects: expected at most {MAX_OBJECTS - 1}, got {len(things)}")
    known = {group.name: group.features.values for group in settings.design_of().schema}
    kinds = tuple(_kind(known, name, thing.words) for name, thing in things.items())
    robot = Robot(settings, read, things, kinds)
    _check_distinct(robot)
    return robot


def _check_distinct(robot: Robot) -> None:
    """Raise ConfigError if two joints have one name, or two things one source."""
    if HAND in robot.objects:
        raise ConfigError(f"objects.{HAND}: expected another name: this one is the hand's")
    things = {f"objects.{name}": thing.source for name, thing in robot.objects.items()}
    frames = {name: getattr(robot.settings, name) for name in ("base_frame", "hand_frame")}
    joints = {f"joints[{i}].name": joint.name for i, joint in enumerate(robot.joints)}
    for names in joints, frames | things:
        owners: dict[str, str] = {}
        for owner, name in names.items():
            if not name or name in owners:
                other = f", as {owners[name]}" if name else ""
                raise ConfigError(f"{owner}: expected a name of its own, got {name!r}{other}")
            owners[name] = owner


def pose_of(offset: Offset, name: str = "offset") -> Float64:
    """The pose [7] of an offset; its quaternion gets length 1. Raises ValueError."""
    pose = IDENTITY.copy()
    if len(offset) not in (0, 3, 7):
        raise ValueError(f"{name}: expected x y z, or x y z qx qy qz qw, got {offset}")
    if not all(abs(number) <= FARTHEST for number in offset):
        raise ValueError(f"{name}: expected numbers of at most {FARTHEST:g}, got {offset}")
    pose[: len(offset)] = offset
    length = float(np.linalg.norm(pose[3:]))
    if not 0.9 < length < 1.1:
        raise ValueError(f"{name}: expected a quaternion of length 1, got length {length:.3g}")
    pose[3:] /= length
    return pose


def _kind(known: dict[str, tuple[str, ...]], name: str, words: tuple[str, ...]) -> Kind:
    """The properties of an object, from its words."""
    found = {group: word for group, values in known.items() for word in values if word in words}
    if not len(found) == len(known) == len(words):
        expected = ", ".join(f"{group} {list(values)}" for group, values in known.items())
        raise ConfigError(
            f"objects.{name}.words: expected one word of each of {expected}, got {list(words)}"
        )
    return Kind(**found)


def _mapping(where: str, values: Any) -> dict[str, Any]:
    if not isinstance(values, dict) or not values:
        raise ConfigError(f"{where}: expected names with their settings, got {values!r}")
    return {str(name): value for name, value in values.items()}


def _entry(kind: type[Entry], where: str, values: Any) -> Entry:
    try:
        return kind(**_mapping("settings", values))
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None
