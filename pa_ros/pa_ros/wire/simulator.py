"""Records of the simulator's services; codes as in msgs_schema, and so in simulation_interfaces."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from pa_ros.core.body import Body
from pa_ros.core.experience import Float64
from pa_ros.wire.interfaces import (
    EntityCategory,
    ResetSimulation,
    Result,
    SetEntityState,
    SetSimulationState,
    SimulationState,
    SimulatorFeatures,
    SpawnEntity,
)


class ResultCode(IntEnum):
    """What became of a call."""

    FEATURE_UNSUPPORTED = Result.RESULT_FEATURE_UNSUPPORTED
    OK = Result.RESULT_OK
    NOT_FOUND = Result.RESULT_NOT_FOUND
    INCORRECT_STATE = Result.RESULT_INCORRECT_STATE
    OPERATION_FAILED = Result.RESULT_OPERATION_FAILED


class SpawnCode(IntEnum):
    """Codes of SpawnEntity alone."""

    NAME_NOT_UNIQUE = SpawnEntity.Response.NAME_NOT_UNIQUE
    NAME_INVALID = SpawnEntity.Response.NAME_INVALID
    UNSUPPORTED_FORMAT = SpawnEntity.Response.UNSUPPORTED_FORMAT
    NO_RESOURCE = SpawnEntity.Response.NO_RESOURCE
    NAMESPACE_INVALID = SpawnEntity.Response.NAMESPACE_INVALID
    INVALID_POSE = SpawnEntity.Response.INVALID_POSE


INVALID_POSE = SetEntityState.Response.INVALID_POSE
ALREADY_IN_TARGET_STATE = SetSimulationState.Response.ALREADY_IN_TARGET_STATE


class SimState(IntEnum):
    """Whether simulation time passes."""

    STOPPED = SimulationState.STATE_STOPPED
    PLAYING = SimulationState.STATE_PLAYING
    PAUSED = SimulationState.STATE_PAUSED


class Scope(IntEnum):
    """What a reset is of; a sum of these."""

    DEFAULT = ResetSimulation.Request.SCOPE_DEFAULT
    TIME = ResetSimulation.Request.SCOPE_TIME
    STATE = ResetSimulation.Request.SCOPE_STATE
    SPAWNED = ResetSimulation.Request.SCOPE_SPAWNED
    ALL = ResetSimulation.Request.SCOPE_ALL


class Category(IntEnum):
    """Kinds of entities that there are here."""

    ROBOT = EntityCategory.CATEGORY_ROBOT
    DYNAMIC_OBJECT = EntityCategory.CATEGORY_DYNAMIC_OBJECT


@dataclass(frozen=True, slots=True)
class Entity:
    """Something in the arena."""

    name: str
    category: Category
    tags: tuple[str, ...]  # words that are true of it
    description: str
    body: Body


@dataclass(frozen=True)
class EntityFilter:
    """Which entities are asked for; empty parts let all pass."""

    pattern: str = ""  # regular expression
    categories: tuple[int, ...] = ()
    tags: tuple[str, ...] = ()
    all_tags: bool = False  # any of them will do
    box: tuple[Float64, Float64] | None = None  # two opposite corners, m
    sphere: tuple[Float64, float] | None = None  # center and radius, m

    def within(self, body: Body) -> bool:
        """Whether a body's center lies within the bounds, if there are any."""
        if self.box is not None:
            low, high = np.minimum(*self.box), np.maximum(*self.box)
            return bool(((low <= body.position) & (body.position <= high)).all())
        if self.sphere is not None:
            return bool(np.linalg.norm(body.position - self.sphere[0]) <= self.sphere[1])
        return True


@dataclass(frozen=True, slots=True)
class Solid:
    """A block as it looks."""

    name: str
    shape: str  # "box", "sphere", "cylinder" or "capsule"
    scale: Float64  # [3] m, whole lengths along its own axes
    rgba: tuple[float, ...]  # [4]
    body: Body


@dataclass(frozen=True, slots=True)
class Spawning:
    """A block that is wanted."""

    name: str
    allow_renaming: bool
    uri: str
    body: Body


@dataclass(frozen=True, slots=True)
class StateChange:
    """Where an entity is wanted, or how moving; None: as it is."""

    entity: str
    pose: Body | None  # of which position and quaternion count
    twist: Body | None  # of which linear and angular count


FEATURES = tuple(
    getattr(SimulatorFeatures, name)
    for name in (
        "SPAWNING", "DELETING", "ENTITY_TAGS", "ENTITY_BOUNDS_BOX", "ENTITY_CATEGORIES",
        "ENTITY_STATE_GETTING", "ENTITY_STATE_SETTING", "ENTITY_INFO_GETTING", "SPAWNABLES",
        "SIMULATION_RESET", "SIMULATION_RESET_STATE", "SIMULATION_RESET_SPAWNED",
        "SIMULATION_STATE_GETTING", "SIMULATION_STATE_SETTING", "SIMULATION_STATE_PAUSE",
        "STEP_SIMULATION_SINGLE", "STEP_SIMULATION_MULTIPLE", "STEP_SIMULATION_ACTION",
    )
)  # fmt: skip
