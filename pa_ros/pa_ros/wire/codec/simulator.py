"""The simulator's services (simulation_interfaces 2.1's, as msgs_schema has them)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pa_ros.core.body import Body
from pa_ros.core.experience import Float64
from pa_ros.wire import errors
from pa_ros.wire.codec.stamp import write_stamp
from pa_ros.wire.interfaces import (
    Bounds,
    EntityCategory,
    EntityFilters,
    EntityState,
    ResetSimulation,
    Resource,
    Result,
    SetEntityState,
    SetSimulationState,
    SimulateSteps,
    Spawnable,
    SpawnEntity,
    StepSimulation,
    TagsFilter,
)
from pa_ros.wire.simulator import FEATURES, Entity, EntityFilter, Spawning, StateChange

WORLD = "world"  # the frame of poses: the arm's base, on the table
MAX_STEPS = 1000  # of the service, which answers only when they are done


def encode_result(response: Any, code: int, message: str = "") -> Any:
    """Fill in what became of a call; returns the response, or an action's result."""
    response.result = Result(result=code, error_message=message)
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


def decode_simulation_state(message: SetSimulationState.Request) -> int:
    """The state wanted."""
    return int(message.state.state)


def decode_simulation_steps(message: StepSimulation.Request | SimulateSteps.Goal) -> int:
    """Control periods. Raises RangeError."""
    most = MAX_STEPS if isinstance(message, StepSimulation.Request) else 2**63 - 1
    if not 1 <= message.steps <= most:
        raise errors.RangeError("step_simulation.steps", f"1 to {most}", message.steps)
    return int(message.steps)


def encode_steps_feedback(completed: int, remaining: int) -> SimulateSteps.Feedback:
    """How far an action has come."""
    return SimulateSteps.Feedback(completed_steps=completed, remaining_steps=remaining)


def encode_steps_result(code: int, message: str = "") -> SimulateSteps.Result:
    """How an action ended."""
    return encode_result(SimulateSteps.Result(), code, message)


def decode_scope(message: ResetSimulation.Request) -> int:
    """What is to be reset."""
    return int(message.scope)


def decode_entity(message: Any) -> str:
    """The name that a request is about."""
    return str(message.entity)


def decode_filters(message: Any) -> EntityFilter:
    """Which entities. Raises RangeError, SizeError for bounds that cannot be."""
    filters: EntityFilters = message.filters
    box, sphere = _bounds(filters.bounds)
    return EntityFilter(
        filters.filter,
        tuple(category.category for category in filters.categories),
        tuple(filters.tags.tags),
        filters.tags.filter_mode == TagsFilter.FILTER_MODE_ALL,
        box,
        sphere,
    )


def decode_spawning(message: SpawnEntity.Request) -> Spawning:
    """A block that is wanted. Raises RangeError for a frame, or a resource, that is not known."""
    _check_frame("spawn_entity.initial_pose", message.initial_pose.header.frame_id)
    for field, value in (
        ("entity_namespace", message.entity_namespace),
        ("entity_resource.resource_string", message.entity_resource.resource_string),
    ):
        if value:
            raise errors.RangeError(f"spawn_entity.{field}", "nothing", value)
    body = _body(message.initial_pose.pose)
    uri = message.entity_resource.uri
    return Spawning(message.name, message.allow_renaming, uri, body)


def decode_state_change(message: SetEntityState.Request) -> StateChange:
    """Where an entity is wanted. Raises RangeError for a frame that is not known."""
    _check_frame("set_entity_state.state", message.state.header.frame_id)
    body = _body(message.state.pose, message.state.twist)
    pose, twist = (body if wanted else None for wanted in (message.set_pose, message.set_twist))
    return StateChange(message.entity, pose, twist)


def encode_state_change(entity: str, place: Body) -> SetEntityState.Request:
    """The inverse, for a pose at rest."""
    state = entity_state(place, 0)
    return SetEntityState.Request(entity=entity, state=state, set_pose=True, set_twist=True)


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
    response.info.category = EntityCategory(category=entity.category)
    response.info.description, response.info.tags = entity.description, list(entity.tags)
    return response


def encode_spawned(response: Any, name: str) -> Any:
    """What a spawned entity is called."""
    response.entity_name = name
    return response


def encode_spawnables(response: Any, described: dict[str, str]) -> Any:
    """What can be spawned: descriptions by uri."""
    response.spawnables = [
        Spawnable(entity_resource=Resource(uri=uri), description=text)
        for uri, text in described.items()
    ]
    return response


def entity_state(body: Body, stamp_ns: int) -> EntityState:
    """A body's state, in the frame WORLD."""
    state = EntityState()
    state.header.frame_id = WORLD
    write_stamp(state.header.stamp, stamp_ns)
    write_vector(state.pose.position, body.position)
    write_vector(state.pose.orientation, body.quaternion, "xyzw")
    write_vector(state.twist.linear, body.linear)
    write_vector(state.twist.angular, body.angular)
    return state


def decode_entity_state(state: EntityState) -> Body:
    """The inverse."""
    return _body(state.pose, state.twist)


def write_vector(target: Any, values: Float64, names: str = "xyz") -> None:
    """Set a vector, a point or a quaternion in place."""
    for name, value in zip(names, values.tolist(), strict=True):
        setattr(target, name, value)


def _read(source: Any, names: str = "xyz") -> Float64:
    return np.array([getattr(source, name) for name in names])


def _body(pose: Any, twist: Any = None) -> Body:
    place = _read(pose.position), _read(pose.orientation, "xyzw")
    if twist is None:
        return Body.at_rest(*place)
    return Body(*place, _read(twist.linear), _read(twist.angular))


def _check_frame(field: str, frame: str) -> None:
    if frame not in ("", WORLD):
        raise errors.RangeError(f"{field}.header.frame_id", f"{WORLD!r} or empty", frame)


def _bounds(
    bounds: Bounds,
) -> tuple[tuple[Float64, Float64] | None, tuple[Float64, float] | None]:
    """A box, or a sphere, or neither."""
    if bounds.type == Bounds.TYPE_EMPTY:
        return None, None
    if bounds.type not in (Bounds.TYPE_BOX, Bounds.TYPE_SPHERE):
        raise errors.RangeError("filters.bounds.type", "a box or a sphere", bounds.type)
    if len(bounds.points) != 2:
        raise errors.SizeError("filters.bounds.points", 2, len(bounds.points))
    first, second = (_read(point) for point in bounds.points)
    if bounds.type == Bounds.TYPE_BOX:
        return (first, second), None
    return None, (first, float(second[0]))
