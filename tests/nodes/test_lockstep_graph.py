"""sim_node and agent_node in lockstep: invariants 1, 2, 6, 7, 8 and 9."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import graph
from pa_ros.language import Program, Word
from pa_ros.ros import topics
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.program import ProgramRequest, decode_program_status, encode_program
from pa_ros.wire.services import (
    ResetRequest,
    decode_outcome,
    encode_reset,
    encode_speed,
)
from pa_ros.wire.simulator import encode_steps_request
from pa_ros.wire.step import Command, decode_clock, encode_command
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
RANDOM = {"agent_node__weights": "random"}


def step_key(message) -> tuple[int, int, int]:
    return message.episode, message.step, header_stamp(message)


def test_everything_of_a_step_says_which_step_it_is():
    with graph(SimNode, AgentNode, sim_node__episode_steps=20, **RANDOM) as probe:
        assert probe.until(lambda: probe.count(topics.OBJECT_FEATURES) > 60)
    steps = [step_key(m) for m in probe.heard["object_features"]]
    assert len({stamp for _, _, stamp in steps}) == len(set(steps))
    known = set(steps)
    commands = [step_key(m) for m in probe.heard["joint_commands"]]
    verdicts = {step_key(m) for m in probe.heard["verdict"]}
    assert commands and set(commands) <= known
    assert len(verdicts & known) >= len(known) - 1
    joints = {header_stamp(m) for m in probe.heard["joint_states"]}
    assert len(joints & {stamp for _, _, stamp in known}) >= len(known) - 1
    assert {m.step for m in probe.heard["object_features"]} >= set(range(21))


def test_an_episodes_last_step_is_answered_by_no_command():
    with graph(SimNode, AgentNode, sim_node__episode_steps=10, **RANDOM) as probe:
        assert probe.until(lambda: probe.last(topics.OBJECT_FEATURES).episode > 2
                           if probe.count(topics.OBJECT_FEATURES) else False)  # fmt: skip
        assert probe.until(lambda: probe.value("sim_node", "refused") != "")
        assert probe.value("sim_node", "refused") == "0"
    steps = {message.step for message in probe.heard["joint_commands"]}
    assert steps == set(range(10))


def test_one_command_moves_one_control_period_and_none_moves_nothing():
    with graph(SimNode, sim_node__resend_period_s=0.3) as probe:
        assert probe.until(lambda: probe.count(topics.OBJECT_FEATURES) > 2)
        assert {step_key(m) for m in probe.heard["object_features"]} == {(0, 0, 100_000_000)}
        speaker = probe.speaker(topics.JOINT_COMMANDS)
        for step in range(5):
            action = np.full(6, 0.1, np.float32)
            stamp = 100_000_000 * (step + 1)
            speaker.publish(encode_command(Command(0, step, stamp, "me", 0, action)))
            assert probe.reaches(step + 1)
            assert probe.last(topics.OBJECT_FEATURES).commanded_by == "me"
        assert probe.nodes[0].session.steps == 5


def test_the_clock_never_goes_back_not_even_at_a_reset():
    with graph(SimNode, AgentNode, sim_node__episode_steps=10, **RANDOM) as probe:
        for episode in (7, 3, None):
            assert probe.until(lambda: probe.count(topics.CLOCK) > 20)
            request = encode_reset(ResetRequest(episode))
            assert probe.call(topics.RESET, request).success
            probe.until(lambda: False, 0.3)
        stamps = [decode_clock(m) for m in probe.heard["clock"]]
    assert stamps == sorted(stamps)
    assert len({m.episode for m in probe.heard["object_features"]}) > 3


def test_a_reset_is_acknowledged_with_its_episode_or_fails_with_a_cause():
    with graph(SimNode) as probe:
        done = probe.call(topics.RESET, encode_reset(ResetRequest(41)))
        assert (done.success, done.episode) == (True, 41)
        assert probe.until(lambda: probe.last(topics.OBJECT_FEATURES).episode == 41)
        refused = probe.call(
            topics.RESET, encode_reset(ResetRequest(42, "NEAR(HAND, AND(RED, BLUE))"))
        )
        assert not refused.success
        assert refused.code == "program.names_nothing" and refused.reason
        assert refused.episode == 41  # goes on as it was
        wrong = probe.call(topics.RESET, encode_reset(ResetRequest(42, "NEAR(HAND, ")))
        assert not wrong.success and "^" in wrong.reason
        asked = probe.call(topics.RESET, encode_reset(ResetRequest(43, "NEAR(HAND,RED)")))
        assert asked.success and asked.episode == 43
        assert probe.nodes[0].session.task.program == Program(Word("RED"))


def test_many_requests_in_flight_are_all_answered():
    with graph(SimNode) as probe:
        client = probe.create_client(topics.RESET[1], topics.RESET[0], qos_profile=topics.SERVICE)
        assert probe.until(client.service_is_ready)
        requests = [encode_reset(ResetRequest(episode)) for episode in range(50)]
        futures = [client.call_async(request) for request in requests]
        assert probe.until(lambda: all(future.done() for future in futures), 60.0)
        answers = [decode_outcome(future.result()) for future in futures]
        assert [(a.success, a.episode) for a in answers] == [(True, n) for n in range(50)]


def _command(**fields) -> Command:
    values = dict(episode=0, step=0, stamp_ns=100_000_000, agent_id="me", policy_version=0,
                  action=np.zeros(6, np.float32))  # fmt: skip
    return Command(**{**values, **fields})


def _with_action(action: list[float]):
    message = encode_command(_command())
    message.action = action
    return message


@pytest.mark.parametrize(
    ("message", "code"),
    [
        (_with_action([0.0] * 5), "wire.size"),
        (_with_action([0.0] * 5 + [math.nan]), "wire.non_finite"),
        (encode_command(_command(episode=3)), "command.stale"),
        (encode_command(_command(step=1)), "command.stale"),
        (encode_command(_command(stamp_ns=1)), "command.stale"),
    ],
)
def test_bad_commands_are_refused_and_counted_and_the_graph_goes_on(message, code):
    with graph(SimNode) as probe:
        speaker = probe.speaker(topics.JOINT_COMMANDS)
        for _ in range(3):
            speaker.publish(message)
        assert probe.until(lambda: probe.value("sim_node", f"refused.{code}") == "3")
        assert probe.nodes[0].session.steps == 0
        speaker.publish(encode_command(_command()))
        assert probe.until(lambda: probe.nodes[0].session.steps == 1)


def test_a_command_beyond_the_limits_is_clamped_counted_and_owned_by_nobody():
    with graph(SimNode) as probe:
        speaker = probe.speaker(topics.JOINT_COMMANDS)
        action = np.array([5.0, 0, 0, 0, 0, -7.0], np.float32)
        speaker.publish(encode_command(_command(action=action)))
        assert probe.reaches(1)
        assert probe.last(topics.OBJECT_FEATURES).commanded_by == ""
        assert probe.until(lambda: probe.value("sim_node", "clamped") == "1")
        assert np.abs(probe.last(topics.JOINT_STATES).velocity).max() < 1.6  # 1.5 rad/s


def test_pause_step_and_speed_say_what_they_did():
    with graph(SimNode, AgentNode, **RANDOM) as probe:
        assert probe.until(lambda: probe.count(topics.OBJECT_FEATURES) > 10)
        running = probe.call(topics.STEP_SIMULATION, encode_steps_request(1))
        assert not running.success and "expected a paused arena" in running.reason
        assert probe.pause().success
        session = probe.nodes[0].session
        before = session.steps
        probe.until(lambda: False, 0.5)
        assert session.steps == before
        assert probe.call(topics.STEP_SIMULATION, encode_steps_request(3)).success
        assert session.steps == before + 3
        assert not probe.call(topics.STEP_SIMULATION, encode_steps_request(0)).success
        assert probe.call(topics.SPEED, encode_speed(2.0)).code == "arena.lockstep"
        assert probe.pause(False).success
        assert probe.until(lambda: session.steps > before + 30)  # the agent is asked again


def test_programs_are_accepted_and_refused_with_a_reason_while_the_arena_runs():
    with graph(SimNode, AgentNode, sim_node__program_source="topic", **RANDOM) as probe:
        speaker = probe.speaker(topics.PROGRAM)

        def ask(program_id: str, text: str) -> dict[str, Any]:
            speaker.publish(encode_program(ProgramRequest(program_id, text)))

            def answers() -> dict[str, Any]:
                found = map(decode_program_status, probe.heard["program_status"])
                return {j.node: j for j in found if j.program_id == program_id}

            assert probe.until(lambda: len(answers()) == 2)
            return answers()

        assert probe.until(lambda: probe.count(topics.OBJECT_FEATURES) > 0)
        assert probe.last(topics.OBJECT_FEATURES).program_id == ""
        good = ask("good", "near".upper() + "(HAND,RED )")
        assert all(j.accepted and j.canonical == "NEAR(HAND, RED)" for j in good.values())
        assert probe.reaches(20)
        assert probe.last(topics.VERDICT).program_id == "good"
        hostile = {
            "empty": "",
            "long": "A" * 1_000_000,
            "deep": "NEAR(HAND, " + "NOT(" * 10_000 + "RED" + ")" * 10_001,
            "unknown": "NEAR(HAND, PINK)",
            "arity": "NEAR(HAND, NOT(RED, BLUE))",
            "case": "NEAR(HAND, red)",
            "ascii": "NEAR(HAND, RÉD)",
        }
        for name, text in hostile.items():
            answers = ask(name, text)
            assert not any(j.accepted for j in answers.values()), name
            assert all(j.code.startswith("program.") and j.reason for j in answers.values())
        unknown = [j for j in map(decode_program_status, probe.heard["program_status"])
                   if j.program_id == "unknown"][0]  # fmt: skip
        assert unknown.position == 11 and "^" in unknown.reason
        absent = ask("absent", "NEAR(HAND, AND(RED, BLUE))")
        assert absent["/sim_node"].code == "program.names_nothing"
        assert probe.last(topics.VERDICT).program_id == "good"  # nothing accepted is lost
        steps = probe.nodes[0].session.steps
        assert probe.until(lambda: probe.nodes[0].session.steps > steps + 20)


def test_a_plain_publisher_is_heard_and_a_latched_program_heard_once():
    with graph(SimNode, sim_node__program_source="topic") as probe:
        from rclpy.event_handler import PublisherEventCallbacks
        from rclpy.qos import QoSProfile

        incompatible: list[Any] = []
        plain = probe.create_publisher(
            topics.PROGRAM.type,
            "program",
            QoSProfile(depth=10),
            event_callbacks=PublisherEventCallbacks(incompatible_qos=incompatible.append),
        )
        assert probe.until(lambda: plain.get_subscription_count() >= 1)
        plain.publish(encode_program(ProgramRequest("", "NEAR(HAND, RED)")))
        assert probe.until(lambda: probe.count(topics.PROGRAM_STATUS) == 1)
        latched = probe.speaker(topics.PROGRAM)
        latched.publish(encode_program(ProgramRequest("two", "NEAR(HAND, BLUE)")))
        assert probe.until(lambda: probe.count(topics.PROGRAM_STATUS) == 2)
        probe.until(lambda: False, 0.5)
        assert probe.count(topics.PROGRAM_STATUS) == 2
        assert not incompatible  # else `ros2 topic pub` says that no messages will be received
