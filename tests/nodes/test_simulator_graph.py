"""The services and the action of simulation_interfaces on a running arena."""

import re
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import Vector3
from rclpy.action import ActionClient
from simulation_interfaces import srv as standard
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import (
    Bounds,
    EntityCategory,
    Result,
    SimulationState,
    SimulatorFeatures,
)

from agent_node.node import AgentNode
from helpers.graph import ACTIVATE, DEACTIVATE, REPEATED, SCENE, TRAINED, Probe, User, graph
from pa_ros.arena.rearranging import bodies
from pa_ros.ros import topics
from pa_ros.ros.actions import SIMULATE_STEPS
from pa_ros.wire.fields import header_stamp, read_stamp
from pa_ros.wire.simulator import ALREADY_IN_TARGET_STATE, INVALID_POSE, ResultCode, SpawnCode
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
ARENA = SCENE | {"sim_node__program_source": "topic"}
OK, FAILED = ResultCode.OK, ResultCode.OPERATION_FAILED
UNSUPPORTED = ResultCode.FEATURE_UNSUPPORTED
STOPPED, PLAYING, PAUSED = 0, 1, 2
CUBE = {"entity": "red_cube"}
MINE = {"name": "mine", "uri": "block:red_cube"}
NO_TURN = {"initial_pose__pose__orientation__w": 0.0}


@pytest.fixture(scope="module")
def running(module_domain: str) -> Iterator[Probe]:
    """One paused arena for all tests of this module."""
    with graph(SimNode, **ARENA, sim_node__paused=True) as probe:
        yield probe


@pytest.fixture
def probe(running: Probe) -> Probe:
    """The arena, paused, as its episode began."""
    code(running, topics.SET_SIMULATION_STATE, state__state=PAUSED)
    assert code(running, topics.RESET_SIMULATION) == OK
    return running


def ask(probe: Probe, service: tuple[str, Any], **fields: Any) -> Any:
    """The response to a request; `a__b` sets the field b of the field a."""
    name, kind = service
    request = kind.Request()
    for path, value in fields.items():
        *parts, last = path.split("__")
        target = request
        for part in parts:
            target = getattr(target, part)
        setattr(target, last, value)
    client = probe.create_client(kind, name)
    assert probe.until(client.service_is_ready)
    future = client.call_async(request)
    assert probe.until(future.done), name
    probe.destroy_client(client)
    return future.result()


def code(probe: Probe, service: tuple[str, Any], **fields: Any) -> int:
    return int(ask(probe, service, **fields).result.result)


def place(probe: Probe, entity: str) -> np.ndarray:
    answer = ask(probe, topics.GET_ENTITY_STATE, entity=entity)
    assert answer.result.result == OK and answer.state.header.frame_id == "world"
    spot = answer.state.pose.position
    return np.array([spot.x, spot.y, spot.z])


def names(probe: Probe, service: tuple[str, Any] = topics.GET_ENTITIES, **fields: Any) -> list[str]:
    answer = ask(probe, service, **fields)
    assert answer.result.result == OK
    return list(answer.entities)


class Steps:
    """A client of the action simulate_steps."""

    def __init__(self, probe: Probe) -> None:
        self._probe, self.feedback = probe, list[Any]()
        self.client = ActionClient(probe, SIMULATE_STEPS[1], SIMULATE_STEPS[0])
        assert probe.until(self.client.server_is_ready)

    def start(self, steps: int) -> Any:
        goal = SimulateSteps.Goal(steps=steps)
        sent = self.client.send_goal_async(goal, lambda m: self.feedback.append(m.feedback))
        assert self._probe.until(sent.done)
        return sent.result()

    def result(self, handle: Any) -> tuple[int, int]:
        future = handle.get_result_async()
        assert self._probe.until(future.done)
        return future.result().status, future.result().result.result.result


def test_an_agent_follows_its_target_while_a_person_moves_removes_and_adds_it():
    with graph(SimNode, AgentNode, **ARENA, **TRAINED, sim_node__real_time_factor=20.0) as probe:
        assert probe.until(lambda: probe.count(topics.OBJECT_FEATURES) > 0)
        assert names(probe)[0] == "hand" and "red_cube" in names(probe) and len(names(probe)) == 5
        speaker = probe.speaker(topics.PROGRAM)
        program = topics.PROGRAM.type(program_id="mine", text="NEAR(HAND, AND(RED, CUBE))")
        speaker.publish(program)

        def near() -> bool:
            return bool(probe.last(topics.OBJECT_FEATURES).satisfied)

        def reached(spot: list[float]) -> bool:
            hand = bodies(probe.nodes[0].session.task)[0].position
            return bool(np.linalg.norm(hand[:2] - spot[:2]) < 0.25)

        def arrived(spot: list[float]) -> bool:
            return near() and reached(spot)

        assert probe.until(near)
        for spot in ([-0.4, -0.1, 0.0], [0.1, 0.5, 0.0]):
            moved = {"state__pose__position__x": spot[0], "state__pose__position__y": spot[1]}
            assert code(probe, topics.SET_ENTITY_STATE, **CUBE, **moved) == OK
            assert probe.until(partial(arrived, spot))
        assert code(probe, topics.DELETE_ENTITY, **CUBE) == OK
        assert probe.until(lambda: probe.last(topics.OBJECT_FEATURES).distance == float("inf"))
        assert probe.last(topics.OBJECT_FEATURES).object_count == 4 and not near()
        at = {"initial_pose__pose__position__x": -0.4, "initial_pose__pose__position__y": -0.3}
        assert ask(probe, topics.SPAWN_ENTITY, **MINE, **at).entity_name == "mine"
        assert probe.until(lambda: near() and reached([-0.4, -0.3]))
        assert probe.last(topics.OBJECT_FEATURES).program_id == "mine"


@pytest.mark.parametrize("mode", ["real_time", "lockstep"])
def test_the_agent_acts_in_each_step_of_the_action_and_the_arm_holds_in_those_of_the_service(mode):
    paused = {"sim_node__paused": True, "sim_node__mode": mode}
    with graph(SimNode, AgentNode, **ARENA | paused, **TRAINED) as probe:
        user = User(probe, probe.nodes[1])
        arena, steps = probe.nodes[0], Steps(probe)
        program = topics.PROGRAM.type(program_id="mine", text="NEAR(HAND, AND(RED, CUBE))")
        probe.speaker(topics.PROGRAM).publish(program)
        assert probe.until(lambda: arena.has_agent)  # else the arm holds in the first steps
        assert steps.result(steps.start(60)) == (GoalStatus.STATUS_SUCCEEDED, OK)
        assert arena.session.steps == 60 and arena.session.current.verdict.satisfied
        executed = [one.commanded_by for one in probe.heard[topics.OBJECT_FEATURES.name]]
        assert probe.nodes[1].agent_id in executed
        assert probe.until(lambda: probe.nodes[1].seen[0].observation.step == 60)
        assert code(probe, topics.STEP_SIMULATION, steps=3) == OK
        assert arena.session.steps == 63 and arena.session.current.executed is None
        assert arena.refusals.counts.keys() <= REPEATED
        # It waits for an agent that is there, but does not act.
        assert user.ask(DEACTIVATE)[0]
        waiting = steps.start(5)
        probe.until(lambda: False, 0.3)
        assert arena.session.steps == 63
        assert user.ask(ACTIVATE)[0]
        assert steps.result(waiting) == (GoalStatus.STATUS_SUCCEEDED, OK)


def test_an_arena_warns_if_another_node_publishes_its_clock():
    with graph(SimNode, remaps=["clock:=/sim/clock"], **ARENA) as probe:
        assert probe.until(lambda: probe.count(topics.CLOCK) > 2)
        assert probe.nodes[0].count_publishers("/sim/clock") == 1
        assert probe.until(lambda: probe.message("sim_node").startswith("waits for a program"))
        intruder = topics.CLOCK.publisher(probe)
        said = "another node publishes /sim/clock, too"
        assert probe.until(lambda: said in probe.message("sim_node"))
        probe.destroy_publisher(intruder)


def test_a_client_that_knows_only_the_standard_uses_the_arena(probe):
    def call(name: str, **fields: Any) -> Any:
        snake = re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()
        answer = ask(probe, (snake, getattr(standard, name)), **fields)
        if hasattr(answer, "result"):
            assert answer.result.result == Result.RESULT_OK, answer.result.error_message
        return answer

    assert SimulatorFeatures.SPAWNING in call("GetSimulatorFeatures").features.features
    assert call("GetSimulationState").state.state == SimulationState.STATE_PAUSED
    at = {"initial_pose__pose__position__y": -0.6}
    uri = call("GetSpawnables").spawnables[0].uri
    name = call("SpawnEntity", uri=uri, allow_renaming=True, **at).entity_name
    state = call("GetEntityState", entity=name).state
    state.pose.position.y = 0.6
    call("SetEntityState", entity=name, state=state)
    assert call("GetEntitiesStates").states[-1].pose.position.y == pytest.approx(0.6)
    info = call("GetEntityInfo", entity=name).info
    assert info.category.category == EntityCategory.CATEGORY_DYNAMIC_OBJECT
    call("StepSimulation")
    call("DeleteEntity", entity=name)
    assert name not in call("GetEntities").entities
    call("SetSimulationState", state__state=SimulationState.STATE_PLAYING)
    call("ResetSimulation", scope=standard.ResetSimulation.Request.SCOPE_STATE)


def test_time_pauses_advances_step_by_step_and_never_goes_back(probe):
    session = probe.nodes[0].session

    def state() -> int:
        return int(ask(probe, topics.GET_SIMULATION_STATE).state.state)

    set_state = partial(code, probe, topics.SET_SIMULATION_STATE)
    step = partial(code, probe, topics.STEP_SIMULATION)
    assert state() == PAUSED and set_state(state__state=PAUSED) == ALREADY_IN_TARGET_STATE
    steps = session.steps
    assert step(steps=7) == OK and session.steps == steps + 7
    assert [step(steps=wrong) for wrong in (0, 10**9)] == [FAILED, FAILED]
    assert set_state(state__state=STOPPED) == OK
    assert state() == STOPPED and session.current.observation.step == 0
    assert step() == OK and state() == PAUSED
    assert set_state(state__state=3) == UNSUPPORTED
    assert set_state(state__state=PLAYING) == OK
    assert state() == PLAYING and probe.reaches(5)
    assert step() == FAILED  # only a paused arena can be stepped
    stamps = [header_stamp(m) for m in probe.heard["object_features"]]
    clock = [read_stamp(m.clock) for m in probe.heard["clock"]]
    assert clock == sorted(clock) and stamps == sorted(set(stamps))


def test_a_reset_has_scopes(probe):
    start = place(probe, "red_cube")
    moved = {"entity": "red_cube", "state__pose__position__x": -0.5}
    spawn = {"uri": "block:blue_capsule", "allow_renaming": True}
    reset = partial(code, probe, topics.RESET_SIMULATION)

    def change() -> None:
        assert code(probe, topics.SET_ENTITY_STATE, **moved) == OK
        spot = {"initial_pose__pose__position__y": -0.6}
        assert ask(probe, topics.SPAWN_ENTITY, **spawn, **spot).entity_name == "blue_capsule"

    def now() -> tuple[bool, bool]:
        """Whether the cube is where it was, and whether the capsule exists."""
        home = bool(np.allclose(place(probe, "red_cube"), start, atol=1e-3))
        return home, "blue_capsule" in names(probe)

    change()
    assert now() == (False, True)
    assert reset(scope=4) == OK and now() == (False, False)
    change()
    assert reset(scope=2) == OK and now() == (True, True)
    assert [reset(scope=scope) for scope in (1, 3, 128)] == [UNSUPPORTED] * 3
    assert now() == (True, True)
    for scope in (0, 255, 6):
        assert reset(scope=scope) == OK and now() == (True, False)
        change()


def test_entities_are_found_by_name_category_tags_and_bounds(probe):
    found = partial(names, probe, topics.GET_ENTITIES_STATES)
    assert found(filters__filter="^red_c") == ["red_cube"]
    cubes = [name for name in found() if name.endswith("cube")]
    assert found(filters__tags__tags=["CUBE"]) == cubes
    both = {"filters__tags__tags": ["RED", "CUBE"]}
    assert found(**both, filters__tags__filter_mode=1) == ["red_cube"]
    assert len(found(**both)) > 1
    info = ask(probe, topics.GET_ENTITY_INFO, entity="red_cube").info
    assert info.category.category == 4 and list(info.tags) == ["RED", "CUBE"]
    robot = ask(probe, topics.GET_ENTITY_INFO, entity="hand").info.category
    assert found(filters__categories=[robot]) == ["hand"]
    x, y, z = place(probe, "red_cube").tolist()
    sphere = [Vector3(x=x, y=y, z=z), Vector3(x=0.01)]
    assert found(filters__bounds=Bounds(type=3, points=sphere)) == ["red_cube"]
    box = [Vector3(x=x + 0.1, y=y + 0.1, z=1.0), Vector3(x=x - 0.1, y=y - 0.1)]
    assert "red_cube" in found(filters__bounds=Bounds(type=1, points=box))
    hull = Bounds(type=2, points=box)
    assert code(probe, topics.GET_ENTITIES, filters__bounds=hull) == FAILED
    features = ask(probe, topics.GET_SIMULATOR_FEATURES).features.features
    assert 11 in features and 21 not in features


@pytest.mark.parametrize(
    ("service", "fields", "expected"),
    [
        (topics.GET_ENTITY_STATE, {"entity": "cup"}, ResultCode.NOT_FOUND),
        (topics.DELETE_ENTITY, {"entity": "cup"}, ResultCode.NOT_FOUND),
        (topics.DELETE_ENTITY, {"entity": "hand"}, FAILED),
        (topics.SET_ENTITY_STATE, {"entity": "hand"}, FAILED),
        (topics.SET_ENTITY_STATE, CUBE | {"state__pose__position__x": 5.0}, INVALID_POSE),
        (topics.SET_ENTITY_STATE, CUBE | {"state__twist__linear__x": np.nan}, INVALID_POSE),
        (topics.SET_ENTITY_STATE, CUBE | {"state__header__frame_id": "moon"}, FAILED),
        (topics.SPAWN_ENTITY, {"name": "mine"}, SpawnCode.NO_RESOURCE),
        (topics.SPAWN_ENTITY, MINE | {"uri": "file:///cup.sdf"}, SpawnCode.UNSUPPORTED_FORMAT),
        (topics.SPAWN_ENTITY, MINE | {"name": "red_cube"}, SpawnCode.NAME_NOT_UNIQUE),
        (topics.SPAWN_ENTITY, MINE | {"name": "my block"}, SpawnCode.NAME_INVALID),
        (topics.SPAWN_ENTITY, MINE | NO_TURN, SpawnCode.INVALID_POSE),
    ],
)
def test_wrong_requests_are_answered_with_the_standards_code(probe, service, fields, expected):
    before, count = place(probe, "red_cube"), probe.nodes[0].refusals.total
    result = ask(probe, service, **fields).result
    assert result.result == expected and "expected" in result.error_message
    assert np.array_equal(place(probe, "red_cube"), before)
    assert probe.nodes[0].refusals.total == count + 1


def test_the_last_block_cannot_be_removed(probe):
    blocks = names(probe)[1:]
    codes = [code(probe, topics.DELETE_ENTITY, entity=name) for name in blocks]
    assert codes == [OK] * (len(blocks) - 1) + [FAILED]


def test_steps_as_an_action_are_counted_and_can_be_cancelled(probe):
    session, steps = probe.nodes[0].session, Steps(probe)
    before = session.steps
    assert steps.result(steps.start(5)) == (GoalStatus.STATUS_SUCCEEDED, OK)
    assert session.steps == before + 5
    assert probe.until(lambda: len(steps.feedback) == 5)
    assert (steps.feedback[-1].completed_steps, steps.feedback[-1].remaining_steps) == (5, 0)
    endless = steps.start(10**9)
    assert steps.result(steps.start(5)) == (GoalStatus.STATUS_ABORTED, FAILED)
    assert probe.until(lambda: session.steps > before + 20)
    assert probe.nodes[0].collect()[1].startswith("paused: makes the requested steps, ")
    assert probe.until(endless.cancel_goal_async().done)
    assert steps.result(endless)[0] == GoalStatus.STATUS_CANCELED
    done = session.steps
    probe.until(lambda: False, 0.3)
    assert session.steps == done
    assert code(probe, topics.SET_SIMULATION_STATE, state__state=PLAYING) == OK
    assert steps.result(steps.start(5)) == (GoalStatus.STATUS_ABORTED, FAILED)
    steps.client.destroy()
