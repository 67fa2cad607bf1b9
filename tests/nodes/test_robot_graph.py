"""robot_node drives an arm through standard topics, and every way to stop it stops it."""

import math
import os
import signal
import time
from contextlib import closing

import pytest
import yaml
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from helpers.graph import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, User, graph
from helpers.robots import SIMULATED, Table, robot_values
from pa_ros.ros import topics
from pa_ros.tools.connection import Connection
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.program import ProgramRequest, encode_program
from sim_node.robot.node import RobotNode

pytestmark = pytest.mark.graph


@pytest.fixture(scope="module")
def table(module_domain, tmp_path_factory):
    folder = tmp_path_factory.mktemp("robot")
    files = {}
    for dry_run in (False, True):
        files[dry_run] = folder / f"{dry_run}.yaml"
        files[dry_run].write_text(yaml.safe_dump(robot_values(dry_run=dry_run), sort_keys=False))
    given = {"robot_node__robot": files[False], "robot_node__autostart": True}
    with graph(RobotNode, SIMULATED.ArmDriver, **given) as probe:
        table = Table(probe, files)
        table.user = User(probe, probe.nodes[0])
        yield table


@pytest.mark.parametrize("lost", ["joints", "hand", "red_sphere"])
def test_the_arm_holds_while_a_measurement_is_lost_and_says_which(table, lost):
    assert table.moves()
    table.lost.add(lost)
    assert table.stops("holds: joint_states" if lost == "joints" else f"holds: {lost}")
    table.lost.clear()
    assert table.moves()


@pytest.mark.parametrize("lacks", ["velocity: expected", "name: expected all joints"])
def test_joint_states_that_cannot_be_used_are_explained_where_the_arm_waits_for_them(table, lacks):
    joints, names = table.probe.speaker(topics.JOINT_STATES), [f"joint_{i}" for i in range(1, 7)]
    used = names if "velocity" in lacks else names[:4]
    bad = JointState(name=used, position=[0.0] * len(used))
    table.lost.add("joints")

    def told() -> bool:
        joints.publish(bad)
        message = table.probe.message("robot_node")
        return f"old; refused: joint_states: joint_states.{lacks}" in message

    assert table.probe.until(told)
    client = Connection("", 10.0, table.probe.context.get_domain_id())
    with closing(client):
        assert table.probe.until(lambda: "/robot_node: holds: joint_states" in client.standstill())
    table.lost.clear()
    assert table.moves()


def test_the_arm_moves_on_beside_large_messages_and_bad_entries(table):
    assert table.moves()
    tf, joints = (table.probe.speaker(topic) for topic in (topics.TF, topics.JOINT_STATES))
    link = TransformStamped(child_frame_id="hand")
    link.header.frame_id, link.transform.rotation.w = "world", math.nan
    tf.publish(TFMessage(transforms=[link] * 1_000))
    tf.publish(TFMessage(transforms=[link]))
    joints.publish(JointState(name=["finger"], velocity=[math.nan]))
    told = lambda code: table.probe.value("robot_node", f"refused.{code}")  # noqa: E731
    assert table.probe.until(lambda: told("robot.size") and told("wire.non_finite"))
    assert table.probe.until(lambda: table.probe.message("robot_node") == "running")


@pytest.mark.parametrize("by_s", [-3600, 3600])
def test_time_goes_on_when_the_wall_clock_is_set(table, monkeypatch, by_s):
    assert table.moves()
    steps, wall_ns = table.probe.heard["object_features"], time.time_ns
    old, began = steps[-1], time.monotonic()
    monkeypatch.setattr(time, "time_ns", lambda: wall_ns() + by_s * 10**9)
    seen = len(steps)
    assert table.probe.until(lambda: len(steps) > seen + 20)
    took_s = time.monotonic() - began
    span_s = (header_stamp(steps[-1]) - header_stamp(old)) / 1e9
    assert 1.0 < span_s < took_s + 1.0
    refused = lambda: table.probe.value("robot_node", "refused.command.stale")  # noqa: E731
    before = refused()
    table.answer(old)
    assert table.probe.until(lambda: refused() != before) and table.moves()


def test_the_arm_holds_without_an_agent(table):
    assert table.moves()
    table.agent = False
    assert table.stops("no agent's command")
    table.agent = True
    assert table.moves()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_arm_stops_when_its_relay_does_and_goes_on_with_another(table, number):
    assert table.moves()
    relay = table.probe.nodes[0].relay.process
    os.kill(relay.pid, number)
    assert table.stops()
    told = lambda: table.probe.value("robot_node", "refused.robot.relay")  # noqa: E731
    assert table.probe.until(told)
    assert table.moves() and relay.poll() is not None


def test_the_arm_holds_while_the_node_is_inactive(table):
    assert table.moves()
    assert table.user.ask(DEACTIVATE) == (True, "inactive")
    assert table.stops("inactive")
    assert table.user.ask(ACTIVATE) == (True, "active")
    assert table.moves()


def test_a_dry_run_shows_what_it_would_send_and_sends_nothing(table):
    for number in (DEACTIVATE, CLEANUP):
        assert table.user.ask(number)[0]
    assert table.user.set("robot", str(table.files[True])) == ""
    for number in (CONFIGURE, ACTIVATE):
        assert table.user.ask(number)[0]
    sent = table.probe.count(topics.VELOCITY_COMMANDS)
    programs = table.probe.speaker(topics.PROGRAM)
    programs.publish(encode_program(ProgramRequest("p", "NEAR(HAND, BLUE)")))
    assert table.probe.until(lambda: any(message.data[0] > 0.2 for message in table.dry))
    assert table.probe.until(lambda: table.probe.count(topics.MARKERS) > 0)
    assert table.probe.count(topics.VELOCITY_COMMANDS) == sent
    assert not table.driver.arm.velocity.any()
