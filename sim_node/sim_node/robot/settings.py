"""What robot.yaml says about a robot and its table. Without ROS; docs/robot.md explains each part.

A wrong file raises ConfigError for its first fault, with the setting's name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

import numpy as np
import yaml
from pydantic import Field, model_validator

from pa_ros.arena import ArenaChoice, Kind
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float64
from pa_ros.core.settings import Settings
from pa_ros.wire.step import MAX_OBJECTS
from pa_ros.world.poses import IDENTITY
from pa_ros.world.schema import ObjectSchema

LONGEST_S = 60.0  # of any age or period
TAG_FRAME = "tag36h11:"  # of tf, before a tag's number; apriltag_ros names it so
Entry = TypeVar("Entry", bound=Settings)
Offset = tuple[float, ...]  # empty, a position (m), or a position and a quaternion xyzw
Place = tuple[float, float, float]
Seconds = Annotated[float, Field(gt=0, le=LONGEST_S)]


class Joint(Settings):
    """A joint of the driver. The agent's angle is sign × the driver's + offset."""

    name: str = Field(description="in joint_states and in commands")
    sign: int = Field(1, ge=-1, le=1, description="1, or -1 if the driver counts the other way")
    offset: float = Field(0.0, description="rad")

    @model_validator(mode="after")
    def _turns(self) -> Self:
        if self.sign == 0:
            raise ValueError("sign: expected 1 or -1, got 0")
        return self


class Thing(Settings):
    """An object on the table: its words, and what measures its pose."""

    words: tuple[str, ...] = Field(description="one of each property group")
    frame: str = Field("", description="tf frame of the object")
    tag: int = Field(-1, ge=-1, description="number of the AprilTag on it")
    detection: str = Field("", description="class in a vision_msgs/Detection3DArray")
    topic: str = Field("", description="of geometry_msgs/PoseStamped")
    offset: Offset = Field((), description="pose of the object's center in what is measured")

    @model_validator(mode="after")
    def _is_measured_once(self) -> Self:
        given = [self.frame, self.detection, self.topic, "tag" if self.tag >= 0 else ""]
        if sum(map(bool, given)) != 1:
            raise ValueError("expected exactly one of frame, tag, detection and topic")
        pose_of(self.offset, "offset")
        return self

    @property
    def source(self) -> str:
        """The frame that measures it: one of tf, or one beside it (`measured_frame`)."""
        tag = f"{TAG_FRAME}{self.tag}" if self.tag >= 0 else ""
        return self.frame or tag or measured_frame(self.detection or self.topic)


class Workspace(Settings):
    """The box that the hand does not leave, in the base's frame."""

    lower: Place = Field(description="m")
    upper: Place = Field(description="m")

    @model_validator(mode="after")
    def _has_room(self) -> Self:
        if not all(low < high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"lower: expected less than upper {self.upper}, got {self.lower}")
        return self


class RobotSettings(ArenaChoice):
    """The settings of robot.yaml but for its joints and objects."""

    SECTION: ClassVar[str] = ""

    dry_run: bool = Field(True, description="only show what would be sent, under dry_run/")
    control: Literal["velocity", "joint_trajectory", "joint_jog"] = Field(
        "velocity", description="what the controller takes"
    )
    base_frame: str = Field(description="tf frame of the arm's base, on the table, z up")
    hand_frame: str = Field(description="tf frame of the hand")
    hand_offset: Offset = Field((), description="pose of the agent's hand in hand_frame")
    workspace: Workspace
    period_s: float = Field(0.1, ge=0.01, le=1.0, description="between two observations")
    speed_scale: float = Field(0.3, gt=0, le=1, description="of the speeds the agent learned with")
    max_acceleration: float = Field(2.0, ge=0, le=1e3, description="rad/s² per joint; 0: no limit")
    command_timeout_s: Seconds = Field(0.3, description="without a command the arm holds")
    arm_timeout_s: Seconds = Field(0.2, description="greatest age of the joints and the hand")
    objects_timeout_s: Seconds = Field(0.5, description="greatest age of an object's pose")

    @model_validator(mode="after")
    def _has_a_hand(self) -> Self:
        pose_of(self.hand_offset, "hand_offset")
        return self


@dataclass(frozen=True)
class Robot:
    """A whole robot.yaml."""

    settings: RobotSettings
    joints: tuple[Joint, ...]  # in the order of the agent's arm
    objects: dict[str, Thing]  # by name, in the order of the observation's rows
    kinds: tuple[Kind, ...]  # of the objects

    @property
    def sources(self) -> dict[str, tuple[str, Float64]]:
        """By object: the frame that measures it, and the object's pose [7] in it."""
        return {name: (t.source, pose_of(t.offset, "offset")) for name, t in self.objects.items()}


def measured_frame(source: str) -> str:
    """The name under which poses from a detection's class or a topic are kept beside tf's."""
    return f"measured:{source}"


def load_robot(path: Path) -> Robot:
    """Read a robot.yaml. Raises ConfigError, with the file's name, for the first fault."""
    try:
        values = yaml.safe_load(path.read_text())
        return read_robot(values)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(
            f"robot: expected a file robot.yaml, got {str(path)!r}: {reason}"
        ) from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        told = " ".join(str(error).split())
        raise ConfigError(f"{path}: expected YAML, got: {told}") from None
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def read_robot(values: Any) -> Robot:
    """The robot of a robot.yaml's values. Raises ConfigError for the first fault."""
    whole = _mapping("robot.yaml", values)
    joints, objects = whole.pop("joints", None), whole.pop("objects", None)
    settings = RobotSettings(**whole)
    expected = settings.arena_config().joints
    if not isinstance(joints, list) or len(joints) != expected:
        given = len(joints) if isinstance(joints, list) else joints
        raise ConfigError(f"joints: expected a list of {expected} for {settings.arm}, got {given}")
    read = tuple(_entry(Joint, f"joints[{i}]", one) for i, one in enumerate(joints))
    names = [joint.name for joint in read]
    if len(set(names)) < len(names):
        raise ConfigError(f"joints: expected different names, got {names}")
    things = {
        str(name): _entry(Thing, f"objects.{name}", one)
        for name, one in _mapping("objects", objects).items()
    }
    if not 0 < len(things) < MAX_OBJECTS:
        raise ConfigError(f"objects: expected 1 to {MAX_OBJECTS - 1}, got {len(things)}")
    schema = settings.design_of().schema
    kinds = tuple(_kind(schema, name, thing.words) for name, thing in things.items())
    return Robot(settings, read, things, kinds)


def pose_of(offset: Offset, name: str) -> Float64:
    """The pose [7] of an offset; its quaternion gets length 1. Raises ValueError."""
    pose = IDENTITY.copy()
    if len(offset) not in (0, 3, 7):
        raise ValueError(f"{name}: expected x y z, or x y z qx qy qz qw, got {offset}")
    pose[: len(offset)] = offset
    length = float(np.linalg.norm(pose[3:]))
    if not 0.9 < length < 1.1:
        raise ValueError(f"{name}: expected a quaternion of length 1, got length {length:.3g}")
    pose[3:] /= length
    return pose


def _kind(schema: ObjectSchema, name: str, words: tuple[str, ...]) -> Kind:
    """The properties of an object, from its words."""
    values = {group.name: group.features.values for group in schema}
    found = {g: word for g, known in values.items() for word in known if word in words}
    if len(found) < len(values) or len(words) != len(values):
        expected = ", ".join(f"{group} {list(known)}" for group, known in values.items())
        raise ConfigError(
            f"objects.{name}.words: expected one word of each of {expected}, got {list(words)}"
        )
    return Kind(**found)


def _mapping(where: str, values: Any) -> dict[str, Any]:
    if not isinstance(values, Mapping) or not values:
        raise ConfigError(f"{where}: expected names with their settings, got {values!r}")
    return {str(name): value for name, value in values.items()}


def _entry(kind: type[Entry], where: str, values: Any) -> Entry:
    try:
        return kind(**_mapping(where, values))
    except ConfigError as error:
        told = str(error).removeprefix(where).removeprefix(": ")
        joint = ": " if told.startswith("expected") else "."
        raise ConfigError(f"{where}{joint}{told}") from None
