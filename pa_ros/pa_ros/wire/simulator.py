"""The simulator's services: those of the package simulation_interfaces, as Jazzy has it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from simulation_interfaces import action, msg, srv

from pa_ros.core.experience import Body, Float64
from pa_ros.wire import WireError
from pa_ros.wire.fields import read_vector, write_stamp, write_vector

WORLD = "world"  # the frame of poses: the arm's base, on the table
# The service step_simulation answers only when all its steps are done, so it takes few.
MAX_STEPS = 1000
FEATURES = tuple(
    getattr(msg.SimulatorFeatures, name)
    for name in (
        "SPAWNING", "DELETING", "ENTITY_TAGS", "ENTITY_BOUNDS_BOX", "ENTITY_CATEGORIES",
        "ENTITY_STATE_GETTING", "ENTITY_STATE_SETTING", "ENTITY_INFO_GETTING", "SPAWNABLES",
        "SIMULATION_RESET", "SIMULATION_RESET_STATE", "SIMULATION_RESET_SPAWNED",
        "SIMULATION_STATE_GETTING", "SIMULATION_STATE_SETTING", "SIMULATION_STATE_PAUSE",
        "STEP_SIMULATION_SINGLE", "STEP_SIMULATION_MULTIPLE", "STEP_SIMULATION_ACTION",
    )
)  # fmt: skip


class ResultCode(IntEnum):
    """The result of a call."""

    FEATURE_UNSUPPORTED = msg.Result.RESULT_FEATURE_UNSUPPORTED
    OK = msg.Result.RESULT_OK
    NOT_FOUND = msg.Result.RESULT_NOT_FOUND
    OPERATION_FAILED = msg.Result.RESULT_OPERATION_FAILED


class SpawnCode(IntEnum):
    """Results that only SpawnEntity has."""

    NAME_NOT_UNIQUE = srv.SpawnEntity.Response.NAME_NOT_UNIQUE
    NAME_INVALID = srv.SpawnEntity.Response.NAME_INVALID
    UNSUPPORTED_FORMAT = srv.SpawnEntity.Response.UNSUPPORTED_FORMAT
    NO_RESOURCE = srv.SpawnEntity.Response.NO_RESOURCE
    INVALID_POSE = srv.SpawnEntity.Response.INVALID_POSE


INVALID_POSE = srv.SetEntityState.Response.INVALID_POSE
ALREADY_IN_TARGET_STATE = srv.SetSimulationState.Response.ALREADY_IN_TARGET_STATE


class SimState(IntEnum):
    """Whether simulation time advances."""

    STOPPED = msg.SimulationState.STATE_STOPPED
    PLAYING = msg.SimulationState.STATE_PLAYING
    PAUSED = msg.SimulationState.STATE_PAUSED


class Scope(IntEnum):
    """Parts of the state that a reset restores; they can be added."""

    DEFAULT = srv.ResetSimulation.Request.SCOPE_DEFAULT
    STATE = srv.ResetSimulation.Request.SCOPE_STATE
    SPAWNED = srv.ResetSimulation.Request.SCOPE_SPAWNED
    ALL = srv.ResetSimulation.Request.SCOPE_ALL


class Category(IntEnum):
    """The kinds of entities in an arena."""

    ROBOT = msg.EntityCategory.CATEGORY_ROBOT
    DYNAMIC_OBJECT = msg.EntityCategory.CATEGORY_DYNAMIC_OBJECT
    STATIC_OBJECT = msg.EntityCategory.CATEGORY_STATIC_OBJECT


@dataclass(frozen=True, slots=True)
class Entity:
    """The hand, or a block."""

    name: str
    category: Category
    tags: tuple[str, ...]  # words that are true of it
    description: str
    body: Body


@dataclass(frozen=True)
class EntityFilter:
    """Which entities to return; an empty part lets all pass."""

    pattern: str = ""  # regular expression
    categories: tuple[int, ...] = ()
    tags: tuple[str, ...] = ()
    all_tags: bool = False  # false: one of the tags is enough
    box: tuple[Float64, Float64] | None = None  # two opposite corners, m
    sphere: tuple[Float64, float] | None = None  # center and radius, m

    def within(self, body: Body) -> bool:
        """Whether a body's center is within the bounds; true without bounds."""
        if self.box is not None:
            low, high = np.minimum(*self.box), np.maximum(*self.box)
            return bool(((low <= body.position) & (body.position <= high)).all())
        if self.sphere is not None:
            return math.dist(body.position, self.sphere[0]) <= self.sphere[1]
        return True


@dataclass(frozen=True, slots=True)
class Spawning:
    """A block to add."""

    name: str
    allow_renaming: bool
    uri: str
    body: Body


# Answers. Each function fills a response and returns it.


def encode_result(response: Any, code: int, message: str = "") -> Any:
    """Fill in the result of a call, or of an action."""
    response.result = msg.Result(result=code, error_message=message)
    return response


def encode_features(response: Any, info: str) -> Any:
    """Fill in the supported parts of the standard, with a text for people."""
    response.features.features = list(FEATURES)
    response.features.custom_info = info
    return response


def encode_simulation_state(response: Any, state: SimState) -> Any:
    """Fill in whether time advances."""
    response.state.state = int(state)
    return response


def encode_entities(response: Any, entities: Sequence[Entity], stamp_ns: int) -> Any:
    """Fill in names and, if the service has them, states."""
    response.entities = [entity.name for entity in entities]
    if hasattr(response, "states"):
        response.states = [_state(entity.body, stamp_ns) for entity in entities]
    return response


def encode_entity(response: Any, entity: Entity, stamp_ns: int) -> Any:
    """Fill in the state or the info of one entity, as the service has it."""
    if hasattr(response, "state"):
        response.state = _state(entity.body, stamp_ns)
    else:
        response.info.category = msg.EntityCategory(category=entity.category)
        response.info.description, response.info.tags = entity.description, list(entity.tags)
    return response


def encode_spawned(response: Any, name: str) -> Any:
    """Fill in the name that a block got."""
    response.entity_name = name
    return response


def encode_spawnables(response: Any, described: dict[str, str]) -> Any:
    """Fill in what can be added: descriptions by uri."""
    response.spawnables = [
        msg.Spawnable(uri=uri, description=text) for uri, text in described.items()
    ]
    return response


def encode_steps_feedback(completed: int, remaining: int) -> action.SimulateSteps.Feedback:
    """The progress of an action simulate_steps."""
    return action.SimulateSteps.Feedback(completed_steps=completed, remaining_steps=remaining)


def encode_steps_result(code: int, message: str = "") -> action.SimulateSteps.Result:
    """How an action simulate_steps ended."""
    return encode_result(action.SimulateSteps.Result(), code, message)


def decode_places(response: Any) -> tuple[list[str], Float64]:
    """The names of the entities, the hand first, and where they are, [N, 3] m."""
    positions = [read_vector(state.pose.position) for state in response.states]
    return [str(name) for name in response.entities], np.array(positions).reshape(-1, 3)


# Requests


def encode_state_request(state: SimState) -> srv.SetSimulationState.Request:
    """The request to pause simulation time, or to let it advance."""
    return srv.SetSimulationState.Request(state=msg.SimulationState(state=int(state)))


def encode_steps_goal(steps: int) -> action.SimulateSteps.Goal:
    """The goal of control periods of a paused arena."""
    return action.SimulateSteps.Goal(steps=steps)


def encode_state_change(entity: str, place: Body) -> srv.SetEntityState.Request:
    """The request to put an entity somewhere, at rest."""
    return srv.SetEntityState.Request(entity=entity, state=_state(place, 0))


def decode_simulation_state(message: srv.SetSimulationState.Request) -> int:
    """The wanted state, one of `SimState` or not."""
    return int(message.state.state)


def decode_simulation_steps(message: srv.StepSimulation.Request | action.SimulateSteps.Goal) -> int:
    """The wanted control periods. Raises WireError."""
    most = MAX_STEPS if isinstance(message, srv.StepSimulation.Request) else 2**63 - 1
    if not 1 <= message.steps <= most:
        raise WireError("step_simulation.steps", f"1 to {most}", message.steps, code="wire.range")
    return int(message.steps)


def decode_scope(message: srv.ResetSimulation.Request) -> int:
    """What to reset, a sum of `Scope` or not."""
    return int(message.scope)


def decode_entity(message: Any) -> str:
    """The name of the entity that a request is about."""
    return str(message.entity)


def decode_filters(message: Any) -> EntityFilter:
    """Which entities to answer with. Raises WireError for impossible bounds."""
    filters: msg.EntityFilters = message.filters
    box, sphere = _bounds(filters.bounds)
    return EntityFilter(
        filters.filter,
        tuple(category.category for category in filters.categories),
        tuple(filters.tags.tags),
        filters.tags.filter_mode == msg.TagsFilter.FILTER_MODE_ALL,
        box,
        sphere,
    )


def decode_spawning(message: srv.SpawnEntity.Request) -> Spawning:
    """The block to add. Raises WireError for another frame."""
    _check_frame("spawn_entity.initial_pose", message.initial_pose.header.frame_id)
    uri, body = message.uri or message.resource_string, _body(message.initial_pose.pose)
    return Spawning(message.name, message.allow_renaming, uri, body)


def decode_state_change(message: srv.SetEntityState.Request) -> tuple[str, Body]:
    """An entity's name and its new state. Raises WireError for another frame."""
    _check_frame("set_entity_state.state", message.state.header.frame_id)
    return message.entity, _body(message.state.pose, message.state.twist)


def _state(body: Body, stamp_ns: int) -> msg.EntityState:
    state = msg.EntityState()
    state.header.frame_id = WORLD
    write_stamp(state.header.stamp, stamp_ns)
    write_vector(state.pose.position, body.position)
    write_vector(state.pose.orientation, body.quaternion, "xyzw")
    write_vector(state.twist.linear, body.linear)
    write_vector(state.twist.angular, body.angular)
    return state


def _body(pose: Any, twist: Any = None) -> Body:
    position, quaternion = read_vector(pose.position), read_vector(pose.orientation, "xyzw")
    if twist is None:
        return Body.at_rest(position, quaternion)
    return Body(position, quaternion, read_vector(twist.linear), read_vector(twist.angular))


def _check_frame(field: str, frame: str) -> None:
    if frame not in ("", WORLD):
        expected = f"{WORLD!r} or empty"
        raise WireError(f"{field}.header.frame_id", expected, frame, code="wire.range")


def _bounds(
    bounds: msg.Bounds,
) -> tuple[tuple[Float64, Float64] | None, tuple[Float64, float] | None]:
    """The corners of a box, and center and radius of a sphere: one of them, or none."""
    if bounds.type == msg.Bounds.TYPE_EMPTY:
        return None, None
    if bounds.type not in (msg.Bounds.TYPE_BOX, msg.Bounds.TYPE_SPHERE):
        raise WireError("filters.bounds.type", "a box or a sphere", bounds.type, code="wire.range")
    if len(bounds.points) != 2:
        raise WireError("filters.bounds.points", 2, len(bounds.points), code="wire.size")
    first, second = (read_vector(point) for point in bounds.points)
    if bounds.type == msg.Bounds.TYPE_BOX:
        return (first, second), None
    return None, (first, float(second[0]))
