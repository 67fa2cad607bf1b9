"""An arena in lockstep, commanded by hand: invariants 2, 7, 8 and 9."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import QoSProfile

from helpers.graph import Probe, graph
from helpers.messages import answer
from pa_ros.core.experience import Observation
from pa_ros.ros import topics
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.program import ProgramRequest, encode_program
from pa_ros.wire.services import ResetRequest, encode_reset
from pa_ros.wire.step import encode_command
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


@pytest.fixture(scope="module")
def running(module_domain: str) -> Iterator[Probe]:
    """One arena, and a publisher of commands, for all tests of this module."""
    with graph(SimNode, sim_node__resend_period_s=0.3) as probe:
        yield probe


@pytest.fixture
def probe(running: Probe) -> Probe:
    """The arena at the beginning of an episode."""
    assert running.call(topics.RESET, encode_reset(ResetRequest())).success
    return running


@pytest.fixture(scope="module")
def commands(running: Probe) -> Any:
    return running.speaker(topics.JOINT_COMMANDS)


def current(probe: Probe) -> Observation:
    return probe.nodes[0].session.current.observation


def test_one_command_moves_one_control_period_and_no_command_moves_nothing(probe, commands):
    session = probe.nodes[0].session
    before, repeated = session.steps, probe.count(topics.OBJECT_FEATURES)
    assert probe.until(lambda: probe.count(topics.OBJECT_FEATURES) > repeated + 1)
    assert session.steps == before
    assert len({header_stamp(m) for m in probe.heard["object_features"][repeated:]}) == 1
    for step in range(1, 6):
        commands.publish(encode_command(answer(current(probe))))
        assert probe.until(lambda: session.steps == before + step)  # noqa: B023
    assert probe.until(lambda: probe.last(topics.OBJECT_FEATURES).commanded_by == "me")


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"action": np.array([0, 0, 0, 0, 0, math.nan], np.float32)}, "wire.non_finite"),
        ({"stamp_ns": 1}, "command.stale"),
    ],
)
def test_bad_commands_are_refused_and_counted(probe, commands, fields, code):
    sim = probe.nodes[0]
    steps, refused = sim.session.steps, sim.refusals.counts[code]
    commands.publish(encode_command(answer(current(probe), **fields)))
    assert probe.until(lambda: sim.refusals.counts[code] == refused + 1)
    assert sim.session.steps == steps
    commands.publish(encode_command(answer(current(probe))))
    assert probe.until(lambda: sim.session.steps == steps + 1)
    assert probe.until(lambda: probe.value("sim_node", f"refused.{code}") == str(refused + 1))


def test_a_reset_is_acknowledged_with_its_episode_or_rejected_with_a_cause(probe):
    done = probe.call(topics.RESET, encode_reset(ResetRequest(41)))
    assert (done.success, done.episode) == (True, 41)
    assert probe.until(lambda: probe.last(topics.OBJECT_FEATURES).episode == 41)
    absent = ResetRequest(42, "NEAR(HAND, AND(RED, BLUE))")
    rejected = probe.call(topics.RESET, encode_reset(absent))
    assert (rejected.success, rejected.code) == (False, "program.names_nothing")
    assert rejected.episode == 41  # unchanged
    wrong = probe.call(topics.RESET, encode_reset(ResetRequest(42, "NEAR(HAND, ")))
    assert not wrong.success and "^" in wrong.reason
    asked = probe.call(topics.RESET, encode_reset(ResetRequest(43, "NEAR(HAND,RED)")))
    assert asked.success and asked.episode == 43
    assert str(probe.nodes[0].session.task.program) == "NEAR(HAND, RED)"


def test_programs_of_a_plain_and_of_a_latched_publisher_are_received_once(probe):
    """`ros2 topic pub` uses a plain publisher; incompatible QoS would make it complain."""
    incompatible: list[Any] = []
    plain = probe.create_publisher(
        topics.PROGRAM.type,
        topics.PROGRAM.name,
        QoSProfile(depth=10),
        event_callbacks=PublisherEventCallbacks(incompatible_qos=incompatible.append),
    )
    assert probe.until(lambda: plain.get_subscription_count() >= 1)
    for number, speaker in enumerate([plain, probe.speaker(topics.PROGRAM)]):
        answered = probe.count(topics.PROGRAM_STATUS)
        program = ProgramRequest(f"program-{number}", "NEAR(HAND, OR(RED, NOT(RED)))")
        speaker.publish(encode_program(program))
        assert probe.until(lambda: probe.count(topics.PROGRAM_STATUS) > answered)  # noqa: B023
        probe.until(lambda: False, 0.3)
        assert probe.count(topics.PROGRAM_STATUS) == answered + 1
    assert not incompatible
