"""The simulator's services, shaped as those of simulation_interfaces 2.1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from msgs_schema import action, msg, srv
from pa_ros.core.body import Body
from pa_ros.core.experience import Float64
from pa_ros.wire.errors import WireError
from pa_ros.wire.fields import read_vector, write_stamp, write_vector

WORLD = "world"  # the frame of poses: the arm's base, on the table
MAX_STEPS = 1000  # of the service, which answers only when they are done


class ResultCode(IntEnum):
    """What became of a call."""

    FEATURE_UNSUPPORTED = msg.Result.RESULT_FEATURE_UNSUPPORTED
    OK = msg.Result.RESULT_OK
    NOT_FOUND = msg.Result.RESULT_NOT_FOUND
    INCORRECT_STATE = msg.Result.RESULT_INCORRECT_STATE
    OPERATION_FAILED = msg.Result.RESULT_OPERATION_FAILED


class SpawnCode(IntEnum):
    """Codes of SpawnEntity alone."""

    NAME_NOT_UNIQUE = srv.SpawnEntity.Response.NAME_NOT_UNIQUE
    NAME_INVALID = srv.SpawnEntity.Response.NAME_INVALID
    UNSUPPORTED_FORMAT = srv.SpawnEntity.Response.UNSUPPORTED_FORMAT
    NO_RESOURCE = srv.SpawnEntity.Response.NO_RESOURCE
    NAMESPACE_INVALID = srv.SpawnEntity.Response.NAMESPACE_INVALID
    INVALID_POSE = srv.SpawnEntity.Response.INVALID_POSE


INVALID_POSE = srv.SetEntityState.Response.INVALID_POSE
ALREADY_IN_TARGET_STATE = srv.SetSimulationState.Response.ALREADY_IN_TARGET_STATE


class SimState(IntEnum):
    """Whether simulation time passes."""

    STOPPED = msg.SimulationState.STATE_STOPPED
    PLAYING = msg.SimulationState.STATE_PLAYING
    PAUSED = msg.SimulationState.STATE_PAUSED


class Scope(IntEnum):
    """What a reset is of; a sum of these."""

    DEFAULT = srv.ResetSimulation.Request.SCOPE_DEFAULT
    TIME = srv.ResetSimulation.Request.SCOPE_TIME
    STATE = srv.ResetSimulation.Request.SCOPE_STATE
    SPAWNED = srv.ResetSimulation.Request.SCOPE_SPAWNED
    ALL = srv.ResetSimulation.Request.SCOPE_ALL


class Category(IntEnum):
    """Kinds of entities that there are here."""

    ROBOT = msg.EntityCategory.CATEGORY_ROBOT
    DYNAMIC_OBJECT = msg.EntityCategory.CATEGORY_DYNAMIC_OBJECT


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
    getattr(msg.SimulatorFeatures, name)
    for name in (
        "SPAWNING", "DELETING", "ENTITY_TAGS", "ENTITY_BOUNDS_BOX", "ENTITY_CATEGORIES",
        "ENTITY_STATE_GETTING", "ENTITY_STATE_SETTING", "ENTITY_INFO_GETTING", "SPAWNABLES",
        "SIMULATION_RESET", "SIMULATION_RESET_STATE", "SIMULATION_RESET_SPAWNED",
        "SIMULATION_STATE_GETTING", "SIMULATION_STATE_SETTING", "SIMULATION_STATE_PAUSE",
        "STEP_SIMULATION_SINGLE", "STEP_SIMULATION_MULTIPLE", "STEP_SIMULATION_ACTION",
    )
)  # fmt: skip


def encode_result(response: Any, code: int, message: str = "") -> Any:
    """Fill in what became of a call; returns the response, or an action's result."""
    response.result = msg.Result(result=code, error_message=message)
    return response


def decode_result(response: Any) -> tuple[int, str]:
    """Code and message of any of these services."""
    return response.result.result, response.result.error_message


def encode_features(response: Any, info: str) -> Any:
    """What the arena can do."""
    response.features.features = list(FEATURES)
    response.features.custom_info = info
    return response


def encode_simulation_state(response: Any, state: int) -> Any:
    """Whether time passes."""
    response.state.state = state
    return response


def decode_simulation_state(message: srv.SetSimulationState.Request) -> int:
    """The state wanted."""
    return int(message.state.state)


def decode_simulation_steps(message: srv.StepSimulation.Request | action.SimulateSteps.Goal) -> int:
    """Control periods. Raises RangeError."""
    most = MAX_STEPS if isinstance(message, srv.StepSimulation.Request) else 2**63 - 1
    if not 1 <= message.steps <= most:
        raise WireError("step_simulation.steps", f"1 to {most}", message.steps, code="wire.range")
    return int(message.steps)


def encode_steps_feedback(completed: int, remaining: int) -> action.SimulateSteps.Feedback:
    """How far an action has come."""
    return action.SimulateSteps.Feedback(completed_steps=completed, remaining_steps=remaining)


def encode_steps_result(code: int, message: str = "") -> action.SimulateSteps.Result:
    """How an action ended."""
    return encode_result(action.SimulateSteps.Result(), code, message)


def encode_simulation_state_request(state: int) -> srv.SetSimulationState.Request:
    """Return the request for a simulation state."""
    return srv.SetSimulationState.Request(state=msg.SimulationState(state=state))


def encode_simulation_steps(steps: int) -> srv.StepSimulation.Request:
    """Return the request for control periods of a paused arena."""
    return srv.StepSimulation.Request(steps=steps)


def decode_scope(message: srv.ResetSimulation.Request) -> int:
    """What is to be reset."""
    return int(message.scope)


def decode_entity(message: Any) -> str:
    """The name that a request is about."""
    return str(message.entity)


def decode_filters(message: Any) -> EntityFilter:
    """Which entities. Raises RangeError, SizeError for bounds that cannot be."""
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
    """A block that is wanted. Raises RangeError for a frame, or a resource, that is not known."""
    _check_frame("spawn_entity.initial_pose", message.initial_pose.header.frame_id)
    for field, value in (
        ("entity_namespace", message.entity_namespace),
        ("entity_resource.resource_string", message.entity_resource.resource_string),
    ):
        if value:
            raise WireError(f"spawn_entity.{field}", "nothing", value, code="wire.range")
    body = _body(message.initial_pose.pose)
    uri = message.entity_resource.uri
    return Spawning(message.name, message.allow_renaming, uri, body)


def decode_state_change(message: srv.SetEntityState.Request) -> StateChange:
    """Where an entity is wanted. Raises RangeError for a frame that is not known."""
    _check_frame("set_entity_state.state", message.state.header.frame_id)
    body = _body(message.state.pose, message.state.twist)
    pose, twist = (body if wanted else None for wanted in (message.set_pose, message.set_twist))
    return StateChange(message.entity, pose, twist)


def encode_state_change(entity: str, place: Body) -> srv.SetEntityState.Request:
    """The inverse, for a pose at rest."""
    state = entity_state(place, 0)
    return srv.SetEntityState.Request(entity=entity, state=state, set_pose=True, set_twist=True)


def decode_names(response: Any) -> list[str]:
    """What the entities are called, the hand first."""
    return [str(name) for name in response.entities]


def encode_entities(response: Any, entities: Sequence[Entity], stamp_ns: int) -> Any:
    """Names and, where the service has them, states."""
    response.entities = [entity.name for entity in entities]
    if hasattr(response, "states"):
        response.states = [entity_state(entity.body, stamp_ns) for entity in entities]
    return response


def encode_entity(response: Any, entity: Entity, stamp_ns: int) -> Any:
    """State or info of one entity, whichever the service is about."""
    if hasattr(response, "state"):
        response.state = entity_state(entity.body, stamp_ns)
        return response
    response.info.category = msg.EntityCategory(category=entity.category)
    response.info.description, response.info.tags = entity.description, list(entity.tags)
    return response


def encode_spawned(response: Any, name: str) -> Any:
    """What a spawned entity is called."""
    response.entity_name = name
    return response


def encode_spawnables(response: Any, described: dict[str, str]) -> Any:
    """What can be spawned: descriptions by uri."""
    response.spawnables = [
        msg.Spawnable(entity_resource=msg.Resource(uri=uri), description=text)
        for uri, text in described.items()
    ]
    return response


def entity_state(body: Body, stamp_ns: int) -> msg.EntityState:
    """A body's state, in the frame WORLD."""
    state = msg.EntityState()
    state.header.frame_id = WORLD
    write_stamp(state.header.stamp, stamp_ns)
    write_vector(state.pose.position, body.position)
    write_vector(state.pose.orientation, body.quaternion, "xyzw")
    write_vector(state.twist.linear, body.linear)
    write_vector(state.twist.angular, body.angular)
    return state


def decode_entity_state(state: msg.EntityState) -> Body:
    """The inverse."""
    return _body(state.pose, state.twist)


def _body(pose: Any, twist: Any = None) -> Body:
    place = read_vector(pose.position), read_vector(pose.orientation, "xyzw")
    if twist is None:
        return Body.at_rest(*place)
    return Body(*place, read_vector(twist.linear), read_vector(twist.angular))


def _check_frame(field: str, frame: str) -> None:
    if frame not in ("", WORLD):
        raise WireError(f"{field}.header.frame_id", f"{WORLD!r} or empty", frame, code="wire.range")


def _bounds(
    bounds: msg.Bounds,
) -> tuple[tuple[Float64, Float64] | None, tuple[Float64, float] | None]:
    """A box, or a sphere, or neither."""
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
