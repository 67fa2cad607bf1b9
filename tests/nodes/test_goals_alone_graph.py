"""Goals for agents that can't pursue them, and clients that ask while an agent is cleaned up."""

import subprocess
import sys
import uuid
from types import SimpleNamespace

import pytest

from agent_node.node import AgentNode
from helpers.graph import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, Probe, User, goals_of, graph
from pa_ros.ros import topics
from pa_ros.ros.actions import EXECUTE_PROGRAM
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.health import WARN
from pa_ros.wire.program import GoalResult, ProgramRequest, encode_program
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


def result_of(probe: Probe, text: str, time_limit_s: float = 0.0) -> GoalResult:
    with goals_of(probe) as goals:
        return goals.result(goals.send(text, time_limit_s, hold_s=0.0))[1]


def test_a_goal_without_an_arena_is_refused() -> None:
    with graph(AgentNode, agent_node__weights="random") as probe:
        assert result_of(probe, "NEAR(HAND, RED)").code == "goal.unready"


def test_a_program_with_words_unknown_to_the_weights_holds_the_arm() -> None:
    scene = {"sim_node__design": "3-D", "sim_node__program_source": "topic"}
    weights = {"agent_node__weights": "checkpoint", "agent_node__checkpoint": "shipped:2-L"}
    with graph(SimNode, AgentNode, **scene, **weights) as probe:  # 2-L has no GREEN
        assert probe.until(lambda: probe.message("agent_node").startswith("waits for a program"))
        text = "NEAR(HAND, GREEN)"
        result = result_of(probe, text)
        assert result.code == "program.unknown_word" and "received 'GREEN'" in result.reason
        probe.speaker(topics.PROGRAM).publish(encode_program(ProgramRequest("green", text)))
        assert probe.until(lambda: "holds the arm" in probe.message("agent_node"))
        assert probe.health["/agent_node"].level == WARN
        seen = probe.count(topics.JOINT_COMMANDS)
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > seen + 10)
        assert not any(probe.last(topics.JOINT_COMMANDS).action)


def test_an_agent_survives_cleanups_while_clients_ask_for_goals_and_results() -> None:
    """In its own process: what fails there ends it by a signal."""
    action = EXECUTE_PROGRAM[1].Impl
    command = [sys.executable, "-m", "agent_node.main", "--ros-args", "-p", "weights:=random"]
    scene = {"sim_node__mode": "real_time", "sim_node__program_source": "topic"}
    with graph(SimNode, **scene) as probe:
        services = {"send_goal": action.SendGoalService, "get_result": action.GetResultService}
        clients = [
            probe.create_client(kind, f"execute_program/_action/{name}")
            for name, kind in services.items()
        ]

        def ask() -> None:
            for client in clients:
                request = client.srv_type.Request()
                request.goal_id.uuid = list(uuid.uuid4().bytes)
                if client.service_is_ready():
                    client.call_async(request)

        with subprocess.Popen(command) as agent:
            try:
                user = User(probe, SimpleNamespace(get_name=lambda: "agent_node"))
                assert probe.until(clients[1].service_is_ready)
                asking = steady_timer(probe, 0.02, ask)
                for _ in range(3):
                    assert user.ask(DEACTIVATE) == (True, "inactive")
                    assert user.ask(CLEANUP) == (True, "unconfigured")
                    probe.until(lambda: False, 0.3)
                    assert agent.poll() is None
                    assert user.ask(CONFIGURE) == (True, "inactive")
                    assert user.ask(ACTIVATE) == (True, "active")
                probe.destroy_timer(asking)
                assert probe.until(lambda: "waits for a program" in probe.message("agent_node"))
                assert result_of(probe, "NEAR(HAND, RED)", 0.5).code in ("", "goal.time_limit")
            finally:
                agent.kill()
