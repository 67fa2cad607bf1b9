"""Many requests at once: each is answered or rejected, none is lost in silence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from lifecycle_msgs.srv import GetAvailableTransitions, GetState
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient

from agent_node.node import AgentNode
from helpers.graph import Probe, graph
from pa_ros.ros import topics
from pa_ros.ros.actions import EXECUTE_PROGRAM
from pa_ros.ros.topics import SERVICE
from pa_ros.wire.program import ProgramGoal, encode_goal
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
SERVICES = [
    *(topics.GET_ENTITIES, topics.GET_SIMULATION_STATE, topics.SET_ENTITY_STATE, topics.SPEED),
    ("agent_node/get_state", GetState),
    ("sim_node/get_available_transitions", GetAvailableTransitions),
    ("agent_node/get_parameters", GetParameters),
]


@pytest.fixture(scope="module")
def probe(module_domain: str) -> Iterator[Probe]:
    arena = {"sim_node__design": "3-D", "sim_node__program_source": "topic"}
    agent = {"agent_node__weights": "checkpoint", "agent_node__checkpoint": "shipped:3-D"}
    with graph(SimNode, AgentNode, **arena, **agent) as probe:
        assert probe.until(lambda: "waits for a program" in probe.message("agent_node"))
        yield probe


@pytest.mark.parametrize("service", SERVICES, ids=lambda service: service[0])
def test_each_of_200_requests_at_once_is_answered(probe: Probe, service: tuple[str, Any]) -> None:
    name, kind = service
    client = probe.create_client(kind, name, qos_profile=SERVICE)
    assert probe.until(client.service_is_ready)
    answers = [client.call_async(kind.Request()) for _ in range(200)]
    assert probe.until(lambda: all(answer.done() for answer in answers))
    probe.destroy_client(client)


def test_each_of_1000_goals_at_once_is_rejected_or_has_a_result(probe: Probe) -> None:
    queues = {f"{name}_service_qos_profile": SERVICE for name in ("goal", "result", "cancel")}
    client = ActionClient(probe, EXECUTE_PROGRAM[1], EXECUTE_PROGRAM[0], **queues)
    assert probe.until(client.server_is_ready)
    goal = encode_goal(ProgramGoal("NEAR(HAND, RED)", 500.0, 1e9))
    answers = [client.send_goal_async(goal) for _ in range(1000)]
    assert probe.until(lambda: all(answer.done() for answer in answers))
    accepted = [answer.result() for answer in answers if answer.result().accepted]
    assert probe.nodes[1].refusals.counts["program.too_many"] == 1000 - len(accepted) > 0
    results = [goal.get_result_async() for goal in accepted]
    cancelled = [goal.cancel_goal_async() for goal in accepted]
    assert probe.until(lambda: all(answer.done() for answer in [*results, *cancelled]))
    client.destroy()
