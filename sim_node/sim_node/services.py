"""The arena's services: its own (reset, speed) and those of simulation_interfaces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pa_ros.core.errors import PaError
from pa_ros.ros import topics
from pa_ros.wire import Message
from pa_ros.wire.services import Outcome, ResetRequest, decode_reset, decode_speed, encode_outcome
from pa_ros.wire.simulator import (
    ALREADY_IN_TARGET_STATE,
    INVALID_POSE,
    ResultCode,
    Scope,
    SimState,
    SpawnCode,
    decode_entity,
    decode_filters,
    decode_scope,
    decode_simulation_state,
    decode_simulation_steps,
    decode_spawning,
    decode_state_change,
    encode_entities,
    encode_entity,
    encode_features,
    encode_result,
    encode_simulation_state,
    encode_spawnables,
    encode_spawned,
)
from sim_node.entities import Entities
from sim_node.running import ArenaNode
from sim_node.session import SimulatorError

ABOUT = "time never goes back; moved blocks are seen from the next step on; docs/graph.md"
TIME_CONTINUES = "done, except for the time: the clock never goes back"
# The standard has its own codes for an impossible pose.
INVALID_POSES = {"set_entity_state": INVALID_POSE, "spawn_entity": SpawnCode.INVALID_POSE}

Answer = Callable[[Message, Any], Any]


class Services:
    """Offers the services of an arena, in its namespace. A PaError is answered with its cause."""

    def __init__(self, arena: ArenaNode, entities: Entities) -> None:
        self._arena, self._entities = arena, entities
        self._stopped_at = -1  # stamp at which the arena was stopped and reset; -1: it was not
        own: dict[tuple[str, Any], Callable[[Message], None]] = {
            topics.RESET: lambda request: arena.begin(decode_reset(request)),
            topics.SPEED: lambda request: arena.set_speed(decode_speed(request)),
        }
        standard: dict[tuple[str, Any], Answer] = {
            topics.GET_SIMULATION_STATE: self._get_state,
            topics.SET_SIMULATION_STATE: self._set_state,
            topics.STEP_SIMULATION: self._step,
            topics.RESET_SIMULATION: self._reset,
            topics.GET_SPAWNABLES: self._get_spawnables,
            topics.SPAWN_ENTITY: self._spawn,
            topics.DELETE_ENTITY: self._delete,
            topics.GET_ENTITIES: self._get_entities,
            topics.GET_ENTITIES_STATES: self._get_entities,
            topics.GET_ENTITY_INFO: self._get_entity,
            topics.GET_ENTITY_STATE: self._get_entity,
            topics.SET_ENTITY_STATE: self._set_entity,
        }
        for (name, kind), act in own.items():
            arena.create_service(kind, name, self._own(name, act))
        for (name, kind), answer in standard.items():
            arena.create_service(kind, name, self._standard(name, answer))
        # An inactive arena answers this one, too.
        name, kind = topics.GET_SIMULATOR_FEATURES
        arena.create_service(kind, name, lambda _, response: encode_features(response, ABOUT))

    def _own(self, name: str, act: Callable[[Message], None]) -> Answer:
        def answer(request: Message, response: Any) -> Any:
            code = reason = ""
            try:
                self._arena.check_active()
                act(request)
            except PaError as error:
                self._arena.refusals.refuse(name, error)
                code, reason = error.code, str(error)
            now = self._arena.session.current.observation
            speed = self._arena.speed
            outcome = Outcome(not code, code, reason, now.episode, now.stamp_ns, speed)
            return encode_outcome(response, outcome)

        return answer

    def _standard(self, name: str, answer: Answer) -> Answer:
        def respond(request: Message, response: Any) -> Any:
            try:
                self._arena.check_active()
                return answer(request, response)
            except PaError as error:
                self._arena.refusals.refuse(name, error)
                code = getattr(error, "result", ResultCode.OPERATION_FAILED)
                if error.code == "arena.scene":
                    code = INVALID_POSES.get(name, code)
                return encode_result(response, code, str(error))

        return respond

    # Time

    @property
    def _stamp_ns(self) -> int:
        return self._arena.session.current.observation.stamp_ns

    @property
    def _state(self) -> SimState:
        if not self._arena.paused:
            return SimState.PLAYING
        return SimState.STOPPED if self._stopped_at == self._stamp_ns else SimState.PAUSED

    def _get_state(self, _request: Message, response: Any) -> Any:
        return _ok(encode_simulation_state(response, self._state))

    def _set_state(self, request: Message, response: Any) -> Any:
        wanted = decode_simulation_state(request)
        if wanted not in tuple(SimState):
            text = f"set_simulation_state.state: expected one of {list(map(int, SimState))}"
            raise SimulatorError(f"{text}, got {wanted}", ResultCode.FEATURE_UNSUPPORTED)
        if wanted == self._state:
            text = f"set_simulation_state.state: expected another than the current, got {wanted}"
            raise SimulatorError(text, ALREADY_IN_TARGET_STATE)
        self._arena.pause(wanted != SimState.PLAYING)
        self._stopped_at = -1
        if wanted == SimState.STOPPED:
            self._restore(Scope.ALL)
            self._stopped_at = self._stamp_ns
        return _ok(response)

    def _step(self, request: Message, response: Any) -> Any:
        self._arena.hold(decode_simulation_steps(request))
        return _ok(response)

    def _reset(self, request: Message, response: Any) -> Any:
        scope = decode_scope(request)
        whole = scope in (Scope.DEFAULT, Scope.ALL)
        if not whole and scope & ~(Scope.STATE | Scope.SPAWNED):
            text = "reset_simulation.scope: expected all, STATE (2), SPAWNED (4) or their sum"
            text += f", as the clock never goes back, got {scope}"
            raise SimulatorError(text, ResultCode.FEATURE_UNSUPPORTED)
        self._restore(Scope.ALL if whole else scope)
        return _ok(response, TIME_CONTINUES if whole else "")

    def _restore(self, scope: int) -> None:
        """Put back what a sum of scopes contains."""
        if not scope & Scope.STATE:
            self._entities.despawn()
            return
        now = self._arena.session.current
        again = ResetRequest(now.observation.episode, evaluation=now.evaluation)
        keep_spawned = not scope & Scope.SPAWNED
        self._entities.restart(lambda: self._arena.begin(again), keep_spawned)

    # Entities

    def _get_spawnables(self, _request: Message, response: Any) -> Any:
        kinds = self._entities.spawnable()
        described = {uri: f"a {kind}" for uri, kind in kinds.items()}
        return _ok(encode_spawnables(response, described))

    def _spawn(self, request: Message, response: Any) -> Any:
        name = self._entities.spawn(decode_spawning(request))
        return _ok(encode_spawned(response, name))

    def _delete(self, request: Message, response: Any) -> Any:
        self._entities.delete(decode_entity(request))
        return _ok(response)

    def _get_entities(self, request: Message, response: Any) -> Any:
        found = self._entities.matching(decode_filters(request))
        return _ok(encode_entities(response, found, self._stamp_ns))

    def _get_entity(self, request: Message, response: Any) -> Any:
        entity = self._entities.named(decode_entity(request))
        return _ok(encode_entity(response, entity, self._stamp_ns))

    def _set_entity(self, request: Message, response: Any) -> Any:
        self._entities.put(*decode_state_change(request))
        return _ok(response)


def _ok(response: Any, message: str = "") -> Any:
    return encode_result(response, ResultCode.OK, message)
