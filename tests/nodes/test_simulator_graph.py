"""The services and the action of simulation_interfaces, on a running arena."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient

from agent_node.node import AgentNode
from helpers.graph import Probe, graph
from msgs_schema.action import SimulateSteps
from pa_ros.arena.rearranging import bodies
from pa_ros.ros import topics
from pa_ros.ros.actions import SIMULATE_STEPS
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.simulator import (
    ALREADY_IN_TARGET_STATE,
    INVALID_POSE,
    ResultCode,
    SpawnCode,
    decode_entity_state,
    decode_result,
)
from pa_ros.wire.step import decode_clock
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
ARENA = {
    "sim_node__design": "3-D",
    "sim_node__seed": 2,
    "sim_node__program_source": "topic",
    "sim_node__mode": "real_time",
}
TRAINED = {"agent_node__weights": "checkpoint", "agent_node__checkpoint": "shipped:3-D"}
OK, FAILED = ResultCode.OK, ResultCode.OPERATION_FAILED
UNSUPPORTED = ResultCode.FEATURE_UNSUPPORTED
STOPPED, PLAYING, PAUSED = 0, 1, 2


def ask(probe: Probe, service, **fields):
    """A response; `a__b` stands for the field b of a."""
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


def code(probe: Probe, service, **fields) -> int:
    return decode_result(ask(probe, service, **fields))[0]


def place(probe: Probe, entity: str) -> np.ndarray:
    told = ask(probe, topics.GET_ENTITY_STATE, entity=entity)
    assert decode_result(told) == (OK, "") and told.state.header.frame_id == "world"
    return decode_entity_state(told.state).position


def stamps(probe: Probe) -> list[int]:
    return [header_stamp(m) for m in probe.heard["object_features"]]


def test_a_person_moves_adds_and_removes_blocks_and_the_program_stays_pursued():
    with graph(SimNode, AgentNode, **ARENA, **TRAINED, sim_node__real_time_factor=20.0) as probe:
        assert probe.until(lambda: probe.count(topics.VERDICT) > 0)
        names = ask(probe, topics.GET_ENTITIES).entities
        assert names[0] == "hand" and "red_cube" in names and len(names) == 5
        speaker = probe.speaker(topics.PROGRAM)
        program = topics.PROGRAM.type(program_id="mine", text="NEAR(HAND, AND(RED, CUBE))")
        speaker.publish(program)

        def near() -> bool:
            return bool(probe.last(topics.VERDICT).satisfied)

        def reached(spot: list[float]) -> bool:
            hand = bodies(probe.nodes[0].session.task)[0].position
            return bool(np.linalg.norm(hand[:2] - spot[:2]) < 0.25)

        def arrived(spot: list[float]) -> bool:
            return near() and reached(spot)

        assert probe.until(near)
        for spot in ([-0.4, -0.1, 0.0], [0.1, 0.5, 0.0]):
            moved = {"state__pose__position__x": spot[0], "state__pose__position__y": spot[1]}
            fields = {"entity": "red_cube", "set_pose": True, **moved}
            assert code(probe, topics.SET_ENTITY_STATE, **fields) == OK
            assert probe.until(partial(arrived, spot))
        assert code(probe, topics.DELETE_ENTITY, entity="red_cube") == OK
        assert probe.until(lambda: probe.last(topics.VERDICT).distance == float("inf"))
        assert probe.last(topics.OBJECT_FEATURES).object_count == 4 and not near()
        spawn = {"name": "mine", "entity_resource__uri": "block:red_cube"}
        at = {"initial_pose__pose__position__x": -0.4, "initial_pose__pose__position__y": -0.3}
        assert ask(probe, topics.SPAWN_ENTITY, **spawn, **at).entity_name == "mine"
        assert probe.until(lambda: near() and reached([-0.4, -0.3]))
        assert probe.last(topics.VERDICT).program_id == "mine"
        assert stamps(probe) == sorted(stamps(probe))
        assert probe.last(topics.OBJECT_FEATURES).episode == 0


def test_time_stops_passes_step_by_step_and_never_goes_back():
    with graph(SimNode, **ARENA) as probe:
        sim = probe.nodes[0]
        assert probe.reaches(2)

        def state() -> int:
            told = ask(probe, topics.GET_SIMULATION_STATE)
            assert decode_result(told)[0] == OK
            return told.state.state

        assert state() == PLAYING
        assert code(probe, topics.STEP_SIMULATION) == FAILED  # not while it runs
        assert code(probe, topics.SET_SIMULATION_STATE, state__state=PAUSED) == OK
        assert state() == PAUSED
        again = code(probe, topics.SET_SIMULATION_STATE, state__state=PAUSED)
        assert again == ALREADY_IN_TARGET_STATE
        steps = sim.session.steps
        assert code(probe, topics.STEP_SIMULATION, steps=7) == OK and sim.session.steps == steps + 7
        assert code(probe, topics.STEP_SIMULATION, steps=0) == FAILED
        assert code(probe, topics.STEP_SIMULATION, steps=10**9) == FAILED
        assert code(probe, topics.SET_SIMULATION_STATE, state__state=STOPPED) == OK
        assert state() == STOPPED and sim.session.frame.observation.step == 0
        assert code(probe, topics.STEP_SIMULATION) == OK and state() == PAUSED
        assert code(probe, topics.SET_SIMULATION_STATE, state__state=3) == UNSUPPORTED
        assert code(probe, topics.SET_SIMULATION_STATE, state__state=PLAYING) == OK
        assert state() == PLAYING and probe.reaches(5)
        clock = [decode_clock(m) for m in probe.heard["clock"]]
        assert clock == sorted(clock) and stamps(probe) == sorted(set(stamps(probe)))


def test_a_reset_has_scopes():
    with graph(SimNode, **ARENA, sim_node__paused=True) as probe:
        start = place(probe, "red_cube")
        moved = {"entity": "red_cube", "set_pose": True, "state__pose__position__x": -0.5}
        spawn = {"entity_resource__uri": "block:blue_capsule", "allow_renaming": True}

        def change() -> None:
            assert code(probe, topics.SET_ENTITY_STATE, **moved) == OK
            spot = {"initial_pose__pose__position__y": -0.6}
            assert ask(probe, topics.SPAWN_ENTITY, **spawn, **spot).entity_name == "blue_capsule"

        def stands() -> tuple[bool, bool]:
            """Whether the cube is where it was, and whether the capsule is there."""
            home = bool(np.allclose(place(probe, "red_cube"), start, atol=1e-3))
            return home, "blue_capsule" in ask(probe, topics.GET_ENTITIES).entities

        change()
        assert stands() == (False, True)
        assert code(probe, topics.RESET_SIMULATION, scope=4) == OK and stands() == (False, False)
        change()
        assert code(probe, topics.RESET_SIMULATION, scope=2) == OK and stands() == (True, True)
        for scope in (1, 3, 8, 128):
            assert code(probe, topics.RESET_SIMULATION, scope=scope) == UNSUPPORTED
        assert stands() == (True, True)
        for scope in (0, 255, 6):
            assert code(probe, topics.RESET_SIMULATION, scope=scope) == OK
            assert stands() == (True, False)
            change()


def test_entities_are_found_by_name_category_tags_and_bounds():
    with graph(SimNode, **ARENA, sim_node__paused=True) as probe:
        features = ask(probe, topics.GET_SIMULATOR_FEATURES).features
        assert 11 in features.features and 21 not in features.features

        def found(**fields) -> list[str]:
            told = ask(probe, topics.GET_ENTITIES_STATES, **fields)
            assert decode_result(told)[0] == OK
            assert len(told.states) == len(told.entities)
            return list(told.entities)

        everything = found()
        assert found(filters__filter="^red_c") == ["red_cube"]
        assert found(filters__tags__tags=["CUBE"]) == [n for n in everything if n.endswith("cube")]
        both = {"filters__tags__tags": ["RED", "CUBE"]}
        assert found(**both, filters__tags__filter_mode=1) == ["red_cube"]
        assert len(found(**both)) > 1
        info = ask(probe, topics.GET_ENTITY_INFO, entity="red_cube").info
        assert info.category.category == 4 and list(info.tags) == ["CUBE", "RED"]
        robots = found(
            filters__categories=[ask(probe, topics.GET_ENTITY_INFO, entity="hand").info.category]
        )
        assert robots == ["hand"]
        bounds = topics.GET_ENTITIES[1].Request().filters.bounds
        point = type(ask(probe, topics.GET_ENTITY_STATE, entity="hand").state.twist.linear)
        x, y, z = place(probe, "red_cube").tolist()
        bounds.type, bounds.points = 3, [point(x=x, y=y, z=z), point(x=0.01)]
        assert found(filters__bounds=bounds) == ["red_cube"]
        bounds.type, bounds.points = (
            1,
            [point(x=x + 0.1, y=y + 0.1, z=1.0), point(x=x - 0.1, y=y - 0.1)],
        )
        assert "red_cube" in found(filters__bounds=bounds)
        bounds.type = 2
        assert code(probe, topics.GET_ENTITIES, filters__bounds=bounds) == FAILED
        assert code(probe, topics.GET_ENTITIES, filters__filter="(") == FAILED


@pytest.mark.parametrize(
    ("service", "fields", "expected"),
    [
        (topics.GET_ENTITY_STATE, {"entity": "cup"}, ResultCode.NOT_FOUND),
        (topics.DELETE_ENTITY, {"entity": "cup"}, ResultCode.NOT_FOUND),
        (topics.DELETE_ENTITY, {"entity": "hand"}, FAILED),
        (topics.SET_ENTITY_STATE, {"entity": "hand", "set_pose": True}, FAILED),
        (
            topics.SET_ENTITY_STATE,
            {"entity": "red_cube", "set_pose": True, "state__pose__position__x": 5.0},
            INVALID_POSE,
        ),
        (
            topics.SET_ENTITY_STATE,
            {"entity": "red_cube", "set_twist": True, "state__twist__linear__x": float("nan")},
            INVALID_POSE,
        ),
        (
            topics.SET_ENTITY_STATE,
            {"entity": "red_cube", "set_pose": True, "state__header__frame_id": "moon"},
            FAILED,
        ),
        (topics.SPAWN_ENTITY, {"name": "mine"}, SpawnCode.NO_RESOURCE),
        (
            topics.SPAWN_ENTITY,
            {"name": "mine", "entity_resource__uri": "file:///cup.sdf"},
            SpawnCode.UNSUPPORTED_FORMAT,
        ),
        (
            topics.SPAWN_ENTITY,
            {"name": "red_cube", "entity_resource__uri": "block:red_cube"},
            SpawnCode.NAME_NOT_UNIQUE,
        ),
        (
            topics.SPAWN_ENTITY,
            {"name": "my block", "entity_resource__uri": "block:red_cube"},
            SpawnCode.NAME_INVALID,
        ),
        (
            topics.SPAWN_ENTITY,
            {
                "name": "mine",
                "entity_resource__uri": "block:red_cube",
                "initial_pose__pose__orientation__w": 0.0,
            },
            SpawnCode.INVALID_POSE,
        ),
    ],
)
def test_what_cannot_be_is_refused_with_the_standards_code(service, fields, expected):
    with graph(SimNode, **ARENA, sim_node__paused=True) as probe:
        before = place(probe, "red_cube")
        answer = ask(probe, service, **fields)
        told, text = decode_result(answer)
        assert told == expected and "expected" in text
        assert np.array_equal(place(probe, "red_cube"), before)
        assert probe.nodes[0].refusals.total == 1


def test_the_last_block_stays():
    with graph(SimNode, **ARENA, sim_node__paused=True) as probe:
        blocks = ask(probe, topics.GET_ENTITIES).entities[1:]
        codes = [code(probe, topics.DELETE_ENTITY, entity=name) for name in blocks]
        assert codes == [OK] * (len(blocks) - 1) + [FAILED]


def test_moved_blocks_are_no_consequence_of_a_command():
    with graph(SimNode, AgentNode, agent_node__learning=True) as probe:
        session = probe.nodes[0].session
        kept = {"entity": ask(probe, topics.GET_ENTITIES).entities[1], "set_pose": True}
        fields = {**kept, "state__pose__position__y": 0.6}
        assert code(probe, topics.SET_ENTITY_STATE, **fields) == OK
        assert session.disturbed
        session.advance(session.hold, "me")
        assert not session.disturbed


def test_steps_as_an_action_are_counted_and_can_be_cancelled():
    with graph(SimNode, **ARENA, sim_node__paused=True) as probe:
        sim, feedback = probe.nodes[0], []
        client = ActionClient(probe, SIMULATE_STEPS[1], SIMULATE_STEPS[0])
        assert probe.until(client.server_is_ready)

        def go(steps: int):
            goal = SimulateSteps.Goal(steps=steps)
            sent = client.send_goal_async(goal, lambda m: feedback.append(m.feedback))
            assert probe.until(sent.done)
            return sent.result()

        def result(handle) -> tuple[int, int]:
            future = handle.get_result_async()
            assert probe.until(future.done)
            return future.result().status, decode_result(future.result().result)[0]

        assert result(go(5)) == (GoalStatus.STATUS_SUCCEEDED, OK)
        assert probe.until(lambda: len(feedback) == 5)
        assert [(f.completed_steps, f.remaining_steps) for f in feedback][-1] == (5, 0)
        assert sim.session.steps == 5
        endless = go(10**9)
        assert result(go(5)) == (GoalStatus.STATUS_ABORTED, FAILED)
        assert probe.until(lambda: sim.session.steps > 20)
        assert probe.until(endless.cancel_goal_async().done)
        assert result(endless)[0] == GoalStatus.STATUS_CANCELED
        steps = sim.session.steps
        probe.until(lambda: False, 0.3)
        assert sim.session.steps == steps
        assert code(probe, topics.SET_SIMULATION_STATE, state__state=PLAYING) == OK
        assert result(go(5)) == (GoalStatus.STATUS_ABORTED, FAILED)
        client.destroy()


@pytest.mark.parametrize("name", ["clock", "/sim/clock"])
def test_an_arena_says_so_if_another_publishes_its_clock(name):
    with graph(SimNode, remaps=[f"clock:={name}"], **ARENA) as probe:
        assert probe.until(lambda: probe.count(topics.CLOCK) > 2)
        full = f"/{name.lstrip('/')}"
        assert probe.nodes[0].count_publishers(full) == 1
        assert probe.until(lambda: probe.message("sim_node").startswith("waits for a program"))
        intruder = topics.CLOCK.publisher(probe)
        said = f"another node publishes {full}, too"
        assert probe.until(lambda: said in probe.message("sim_node"))
        probe.destroy_publisher(intruder)
