"""The action execute_program: reached, refused, replaced, cancelled.

Most tests share one graph: an arena at a hundred times real time and a trained agent that uses its
clock. Results are kept for a minute of wall time. On the node's clock that would be 0.6 s here.
"""

from collections.abc import Iterator

import pytest
from action_msgs.msg import GoalStatus

from agent_node.node import AgentNode
from helpers.graph import SCENE, TRAINED, GoalSender, Probe, goals_of, graph
from pa_ros.ros import topics
from pa_ros.wire.program import decode_program_status
from pa_ros.wire.services import encode_speed
from pa_ros.wire.step import encode_clock
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
FAST = {
    "sim_node__program_source": "topic",
    "sim_node__real_time_factor": 100.0,
    "agent_node__use_sim_time": True,
}
REACHABLE = "NEAR(HAND, AND(RED, CUBE))"
SUCCEEDED, CANCELED, ABORTED = (
    GoalStatus.STATUS_SUCCEEDED,
    GoalStatus.STATUS_CANCELED,
    GoalStatus.STATUS_ABORTED,
)


@pytest.fixture(scope="module")
def probe(module_domain: str) -> Iterator[Probe]:
    with graph(SimNode, AgentNode, **SCENE, **TRAINED, **FAST) as probe:
        assert probe.until(lambda: "waits for a program" in probe.message("agent_node"))
        yield probe


@pytest.fixture
def client(probe: Probe) -> Iterator[GoalSender]:
    with goals_of(probe) as sender:
        yield sender


def commanded(probe: Probe) -> bool:
    """Whether the newest command moves the arm."""
    return any(probe.last(topics.JOINT_COMMANDS).action)


def test_the_programs_of_a_goal_over_time_are_reached_one_after_the_other(probe, client) -> None:
    text = f"THEN(NEAR(HAND, AND(GREEN, CUBE)), {REACHABLE}, NEAR(HAND, AND(GREEN, CUBE)))"
    status, result = client.result(client.send(text, time_limit_s=1000.0))
    assert (status, result.success, result.code) == (SUCCEEDED, True, "")
    steps = [m for m in probe.heard["object_features"] if m.program == text]
    seen = [m.stage for m in steps]
    assert seen == sorted(seen) and (seen[0], seen[-1]) == (0, 2)
    assert {m.stage for m in steps if m.satisfied} == {2}
    handle = client.send(text, hold_s=1e9)  # so that it lasts until feedback is sent
    assert probe.until(lambda: any(feedback.stages == 3 for feedback in client.feedback))
    assert probe.until(handle.cancel_goal_async().done)


def test_cancelling_holds_the_arm(probe: Probe, client: GoalSender) -> None:
    handle = client.send("NEAR(HAND, AND(GREEN, CUBE))", hold_s=1e9)
    assert probe.until(lambda: any(f.relevance for f in client.feedback))
    cancelled = handle.cancel_goal_async()
    assert probe.until(cancelled.done)
    status, result = client.result(handle)
    assert (status, result.code) == (CANCELED, "goal.cancelled")
    assert probe.until(lambda: not commanded(probe))
    held = probe.count(topics.JOINT_COMMANDS)
    assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > held + 20)
    assert not any(any(m.action) for m in probe.heard["joint_commands"][held:])
    assert client.result(client.send(REACHABLE))[1].success


@pytest.mark.parametrize(
    ("text", "limit", "code", "position"),
    [
        ("NEAR(HAND, RAD)", 0.0, "program.unknown_word", 11),  # by the agent
        ("NEAR(HAND, AND(RED, A))", 0.0, "program.names_nothing", 11),  # by the arena
        ("NEAR(HAND, RED)", -1.0, "wire.range", -1),
    ],
)
def test_a_rejected_goal_says_why_and_where(client, text, limit, code, position) -> None:
    status, result = client.result(client.send(text, time_limit_s=limit))
    assert (status, result.code, result.position) == (ABORTED, code, position)
    assert "expected" in result.reason and ("^" in result.reason or position < 0)


def test_another_goal_and_another_program_replace_a_goal(probe: Probe, client: GoalSender) -> None:
    first = client.send("NEAR(HAND, RED)", hold_s=1e9)
    assert probe.until(lambda: len(client.feedback) > 2)
    second = client.send("NEAR(HAND, GREEN)", hold_s=1e9)
    status, result = client.result(first)
    assert (status, result.code) == (ABORTED, "goal.replaced")
    green = lambda: probe.last(topics.OBJECT_FEATURES).program == "NEAR(HAND, GREEN)"  # noqa: E731
    assert probe.until(green)
    other = topics.PROGRAM.type(program_id="mine", text="NEAR(HAND, CUBE)")
    probe.speaker(topics.PROGRAM).publish(other)
    status, result = client.result(second)
    assert (status, result.code) == (ABORTED, "goal.replaced")


def test_a_goal_replaced_before_its_first_step_is_aborted(probe: Probe, client: GoalSender) -> None:
    """A program takes effect with the next step, which is slow to come here."""
    speaker = probe.speaker(topics.PROGRAM)
    assert probe.call(topics.SPEED, encode_speed(0.2)).success
    own: list[str] = []

    def replace(message) -> None:
        answer = decode_program_status(message)
        if answer.node == "/sim_node" and answer.program_id.startswith("agent_node-"):
            own.append(answer.program_id)
            speaker.publish(topics.PROGRAM.type(program_id="after", text="NEAR(HAND, GREEN)"))

    replacing = topics.PROGRAM_STATUS.subscribe(probe, replace)
    status, result = client.result(client.send("NEAR(HAND, RED)", time_limit_s=2.0))
    probe.destroy_subscription(replacing)
    assert probe.call(topics.SPEED, encode_speed(100.0)).success
    assert (status, result.code) == (ABORTED, "goal.replaced")
    assert own[-1] not in {message.program_id for message in probe.heard["object_features"]}


def test_the_time_limit_ends_a_goal_and_holds_the_arm(probe: Probe, client: GoalSender) -> None:
    goal = client.send("NEAR(HAND, GREEN)", time_limit_s=3.0, hold_s=1e9)
    status, result = client.result(goal)
    assert (status, result.success, result.code) == (ABORTED, False, "goal.time_limit")
    assert "3 s" in result.reason
    assert probe.until(lambda: not commanded(probe))


def test_a_goal_ends_with_its_arena_and_keeps_its_result(probe: Probe, client: GoalSender) -> None:
    handle = client.send("NEAR(HAND, RED)", hold_s=1e9)
    assert probe.until(lambda: len(client.feedback) > 1)
    arena, agent = probe.nodes
    probe.end(arena)  # this is the last test that needs it
    result = client.result(handle)
    assert result[1].code == "goal.arena_gone"
    clock = topics.CLOCK.publisher(probe)
    later = agent.get_clock().now().nanoseconds + 2000 * 10**9

    def passed() -> bool:
        clock.publish(encode_clock(later))
        return bool(agent.get_clock().now().nanoseconds >= later)

    assert probe.until(passed)
    assert client.result(handle) == result
