"""The action execute_program: reached, refused, replaced, cancelled; at any speed."""

from __future__ import annotations

import subprocess
import sys
import uuid
from types import SimpleNamespace

import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient

from agent_node.node import AgentNode
from helpers.graph import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, Probe, User, graph
from pa_ros.ros import topics
from pa_ros.ros.actions import EXECUTE_PROGRAM
from pa_ros.ros.executor import steady_timer
from pa_ros.wire.program import (
    GoalProgress,
    GoalResult,
    ProgramGoal,
    ProgramRequest,
    decode_goal_feedback,
    decode_goal_result,
    decode_program_status,
    encode_goal,
    encode_program,
)
from pa_ros.wire.step import encode_clock
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
SCENE = {"sim_node__design": "3-D", "sim_node__seed": 2, "sim_node__program_source": "topic"}
FAST = {"sim_node__mode": "real_time", "sim_node__real_time_factor": 100.0}
TRAINED = {"agent_node__weights": "checkpoint", "agent_node__checkpoint": "shipped:3-D"}
RANDOM = {"agent_node__weights": "random"}
# `action_msgs` status → what a client is told
SUCCEEDED, CANCELED, ABORTED = (
    GoalStatus.STATUS_SUCCEEDED,
    GoalStatus.STATUS_CANCELED,
    GoalStatus.STATUS_ABORTED,
)


class Client:
    """Sends goals, and keeps what comes back."""

    def __init__(self, probe: Probe) -> None:
        self.probe = probe
        self.feedback: list[GoalProgress] = []
        self.client = ActionClient(probe, EXECUTE_PROGRAM[1], EXECUTE_PROGRAM[0])
        assert probe.until(self.client.server_is_ready)
        assert probe.until(lambda: probe.count(topics.OBJECT_FEATURES) > 0)

    def send(self, text: str, time_limit_s: float = 0.0, hold_s: float = 1.0):
        """The handle of a goal, once it is taken up."""
        goal = encode_goal(ProgramGoal(text, time_limit_s, hold_s))
        sent = self.client.send_goal_async(goal, feedback_callback=self._keep)
        assert self.probe.until(sent.done)
        assert sent.result().accepted
        return sent.result()

    def _keep(self, message) -> None:
        self.feedback.append(decode_goal_feedback(message.feedback))

    def result(self, handle) -> tuple[int, GoalResult]:
        future = handle.get_result_async()
        assert self.probe.until(future.done)
        return future.result().status, decode_goal_result(future.result().result)

    def close(self) -> None:
        self.client.destroy()


def still(probe: Probe) -> bool:
    """Whether the arm rests in what is seen last."""
    return max(map(abs, probe.last(topics.JOINT_STATES).velocity)) < 0.02


@pytest.mark.parametrize("use_sim_time", [False, True])
def test_a_goal_is_reached_at_a_hundred_times_real_time_and_its_result_stays(use_sim_time):
    """By simulated time the result would be gone after nine seconds (rclpy keeps it 900 s)."""
    times = {"agent_node__use_sim_time": use_sim_time}
    with graph(SimNode, AgentNode, **SCENE, **FAST, **TRAINED, **times) as probe:
        client = Client(probe)
        handle = client.send("NEAR(HAND, AND(RED, CUBE))", time_limit_s=500.0)
        status, result = client.result(handle)
        assert (status, result.success, result.code) == (SUCCEEDED, True, "")
        assert 0 < result.time_to_reach_s < 500 and result.final_distance < 0.2
        if use_sim_time:
            assert probe.pause().success
            agent, clock = probe.nodes[1], topics.CLOCK.publisher(probe)
            later = agent.get_clock().now().nanoseconds + 2000 * 10**9

            def passed() -> bool:
                clock.publish(encode_clock(later))
                return bool(agent.get_clock().now().nanoseconds >= later)

            assert probe.until(passed)
            assert client.result(handle) == (status, result)
            assert probe.pause(False).success
            assert client.result(client.send("NEAR(HAND, SPHERE)"))[1].success
        client.close()


def test_feedback_tells_what_the_agent_takes_the_program_to_mean():
    with graph(SimNode, AgentNode, **SCENE, **TRAINED, sim_node__mode="real_time") as probe:
        client = Client(probe)
        handle = client.send("NEAR(HAND, AND(RED, CUBE))")
        assert probe.until(lambda: any(f.relevance for f in client.feedback))
        seen = next(f for f in client.feedback if f.relevance)
        meant = dict(zip(seen.objects, seen.relevance, strict=True))
        assert meant["hand"] == pytest.approx(1.0) and "RED CUBE" in meant
        assert meant["RED CUBE"] > 0.8 and min(meant.values()) < 0.2
        assert seen.policy_version == probe.nodes[1].agent.version
        assert client.result(handle)[1].success
        client.close()


@pytest.mark.parametrize(
    ("text", "code", "position"),
    [
        ("NEAR(HAND, RAD)", "program.unknown_word", 11),  # by the agent
        ("NEAR(HAND, AND(RED, A))", "program.names_nothing", 11),  # by the arena
    ],
)
def test_a_refusal_says_why_and_where(text, code, position):
    with graph(SimNode, AgentNode, **SCENE, **RANDOM, sim_node__mode="real_time") as probe:
        client = Client(probe)
        status, result = client.result(client.send(text))
        assert (status, result.code, result.position) == (ABORTED, code, position)
        assert "expected" in result.reason and "^" in result.reason
        assert probe.until(lambda: probe.value("agent_node", "refused") != "")
        client.close()


@pytest.mark.parametrize("limit", [-1.0, float("nan"), float("inf")])
def test_times_that_are_none_are_refused(limit):
    with graph(SimNode, AgentNode, **SCENE, **RANDOM, sim_node__mode="real_time") as probe:
        client = Client(probe)
        status, result = client.result(client.send("NEAR(HAND, RED)", time_limit_s=limit))
        assert (status, result.code) == (ABORTED, "wire.range")
        client.close()


def test_a_goal_without_an_arena_is_refused():
    with graph(AgentNode, **RANDOM) as probe:
        client = ActionClient(probe, EXECUTE_PROGRAM[1], EXECUTE_PROGRAM[0])
        assert probe.until(client.server_is_ready)
        sent = client.send_goal_async(encode_goal(ProgramGoal("NEAR(HAND, RED)")))
        assert probe.until(sent.done)
        future = sent.result().get_result_async()
        assert probe.until(future.done)
        assert decode_goal_result(future.result().result).code == "goal.unready"
        client.destroy()


def test_another_goal_takes_the_place_of_the_first():
    with graph(SimNode, AgentNode, **SCENE, **RANDOM, sim_node__mode="real_time") as probe:
        client = Client(probe)
        first = client.send("NEAR(HAND, RED)")
        assert probe.until(lambda: len(client.feedback) > 2)
        second = client.send("NEAR(HAND, GREEN)")
        status, result = client.result(first)
        assert (status, result.code) == (ABORTED, "goal.replaced")
        sim = probe.nodes[0]
        assert probe.until(lambda: str(sim.session.program.program) == "NEAR(HAND, GREEN)")
        third = probe.speaker(topics.PROGRAM)  # and so does a program by the topic
        third.publish(topics.PROGRAM.type(program_id="mine", text="NEAR(HAND, CUBE)"))
        status, result = client.result(second)
        assert (status, result.code) == (ABORTED, "goal.replaced")
        client.close()


def test_a_goal_that_is_replaced_before_its_first_step_ends():
    """A program takes effect with the next step, which here is long in coming."""
    slow = {"sim_node__mode": "real_time", "sim_node__real_time_factor": 0.2}
    with graph(SimNode, AgentNode, **SCENE, **RANDOM, **slow) as probe:
        client, speaker = Client(probe), probe.speaker(topics.PROGRAM)
        own: list[str] = []

        def replace(message) -> None:
            answer = decode_program_status(message)
            if answer.node == "/sim_node" and answer.program_id.startswith("agent_node-"):
                own.append(answer.program_id)
                speaker.publish(topics.PROGRAM.type(program_id="mine", text="NEAR(HAND, GREEN)"))

        speaker.publish(topics.PROGRAM.type(program_id="first", text="NEAR(HAND, CUBE)"))
        verdicts = probe.heard["verdict"]
        assert probe.until(lambda: bool(verdicts) and verdicts[-1].program_id == "first")
        topics.PROGRAM_STATUS.subscribe(probe, replace)
        status, result = client.result(client.send("NEAR(HAND, RED)", time_limit_s=2.0))
        assert (status, result.code) == (ABORTED, "goal.replaced") and len(own) == 1
        assert own[0] not in {message.program_id for message in verdicts}
        client.close()


@pytest.mark.parametrize("speed", [FAST, {"sim_node__mode": "lockstep"}])
def test_cancelling_holds_the_arm_until_another_program_comes(speed):
    with graph(SimNode, AgentNode, **SCENE, **TRAINED, **speed) as probe:
        client = Client(probe)
        handle = client.send("NEAR(HAND, AND(GREEN, CUBE))", hold_s=1e9)
        assert probe.until(lambda: any(f.relevance for f in client.feedback))
        cancelled = handle.cancel_goal_async()
        assert probe.until(cancelled.done)
        status, result = client.result(handle)
        assert (status, result.code) == (CANCELED, "goal.cancelled")
        assert probe.until(lambda: still(probe))
        commands = probe.count(topics.JOINT_COMMANDS)
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > commands + 20)
        assert all(not any(m.action) for m in probe.heard["joint_commands"][commands + 1 :])
        client.send("NEAR(HAND, AND(RED, CUBE))")
        assert probe.until(lambda: any(probe.last(topics.JOINT_COMMANDS).action))
        client.close()


def test_the_time_limit_ends_a_goal_and_holds_the_arm():
    with graph(SimNode, AgentNode, **SCENE, **RANDOM, **FAST) as probe:
        client = Client(probe)
        status, result = client.result(client.send("NEAR(HAND, RED)", time_limit_s=3.0))
        assert (status, result.success, result.code) == (ABORTED, False, "goal.time_limit")
        assert "3 s" in result.reason and result.time_to_reach_s is None
        assert probe.until(lambda: not any(probe.last(topics.JOINT_COMMANDS).action))
        client.close()


def test_words_that_the_weights_lack_are_refused_and_the_arm_holds_under_them():
    less = {**TRAINED, "agent_node__checkpoint": "shipped:2-L"}  # which has no GREEN
    with graph(SimNode, AgentNode, **SCENE, **less) as probe:
        client, text = Client(probe), "NEAR(HAND, GREEN)"
        status, result = client.result(client.send(text))
        assert (status, result.code) == (ABORTED, "program.unknown_word")
        assert "received 'GREEN'" in result.reason
        probe.speaker(topics.PROGRAM).publish(encode_program(ProgramRequest("green", text)))
        assert probe.until(lambda: "holds the arm" in probe.message("agent_node"))
        seen = probe.count(topics.JOINT_COMMANDS)
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > seen + 10)
        assert not any(probe.last(topics.JOINT_COMMANDS).action)
        client.close()


def test_a_goal_on_another_arm_than_the_weights_are_for_is_refused():
    with graph(SimNode, AgentNode, **SCENE, **TRAINED, sim_node__arm="panda") as probe:
        client = Client(probe)
        status, result = client.result(client.send("NEAR(HAND, RED)"))
        assert (status, result.code) == (ABORTED, "learning.policy")
        assert "expected an arm of 6 joints, got 7" in result.reason
        client.close()


@pytest.mark.parametrize("remaps", [[], ["verdict:=judged"]])
def test_an_arena_that_goes_ends_the_goal(remaps):
    real_time = {**RANDOM, "sim_node__mode": "real_time"}
    with graph(SimNode, AgentNode, remaps=remaps, **SCENE, **real_time) as probe:
        client = Client(probe)
        handle = client.send("NEAR(HAND, RED)")
        assert probe.until(lambda: len(client.feedback) > 1)
        sim = probe.nodes.pop(0)
        sim.close()
        sim.destroy_node()
        assert client.result(handle)[1].code == "goal.arena_gone"
        client.close()


def test_an_agent_that_learns_offers_no_goals():
    with graph(SimNode, AgentNode, agent_node__learning=True) as probe:
        assert probe.until(lambda: probe.value("agent_node", "agent_id") != "")
        client = ActionClient(probe, EXECUTE_PROGRAM[1], EXECUTE_PROGRAM[0])
        assert not probe.until(client.server_is_ready, 1.0)
        client.destroy()


def test_an_agent_lives_through_cleanups_while_clients_ask_for_goals_and_results():
    """A process of its own: what goes wrong there ends it by a signal."""
    action = EXECUTE_PROGRAM[1].Impl
    command = [sys.executable, "-m", "agent_node.main", "--ros-args", "-p", "weights:=random"]
    with graph(SimNode, **SCENE, sim_node__mode="real_time") as probe:
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
                client = Client(probe)
                assert probe.until(lambda: "acting" in probe.message("agent_node"))
                reached = client.result(client.send("NEAR(HAND, RED)", time_limit_s=0.5))
                assert reached[1].code in ("", "goal.time_limit")
                client.close()
            finally:
                agent.kill()
