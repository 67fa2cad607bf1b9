"""robot_node drives an arm through standard topics, and every way to stop it stops it."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from helpers.graph import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, User, graph
from helpers.robots import robot_values
from pa_ros.core.extensions import load
from pa_ros.ros import topics
from pa_ros.wire.program import ProgramRequest, encode_program
from pa_ros.wire.step import Command, encode_command
from sim_node.robot.node import RobotNode

pytestmark = pytest.mark.graph
EXAMPLES = Path(__file__).parents[2] / "docs/examples"
DRY = topics.VELOCITY_COMMANDS.within("dry_run")


class Table:
    """robot_node, the simulated arm, and an agent that always turns the arm's base."""

    def __init__(self, probe, files) -> None:
        self.probe, self.files, (self.robot, self.driver) = probe, files, probe.nodes
        self.user = User(probe, self.robot)
        self.lost, self.agent, self.count, self.dry = set(), True, 0, []
        joints, tf = self.driver.joints, self.driver.tf
        send_joints, send_tf = joints.publish, tf.publish
        joints.publish = lambda m: None if "joints" in self.lost else send_joints(m)
        tf.publish = lambda m: send_tf(self.without_lost(m))
        probe.create_subscription(DRY.type, DRY.name, self.dry.append, 10)
        self.commands = probe.speaker(topics.JOINT_COMMANDS)
        features = topics.OBJECT_FEATURES
        features.subscribe(probe, self.on_step)
        programs = probe.speaker(topics.PROGRAM)
        programs.publish(encode_program(ProgramRequest("p", "NEAR(HAND, BLUE)")))
        assert probe.until(lambda: probe.count(topics.PROGRAM_STATUS) > 0)

    def without_lost(self, message):
        message.transforms = [t for t in message.transforms if t.child_frame_id not in self.lost]
        return message

    def on_step(self, message) -> None:
        if self.agent and message.program:
            self.count += 1
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            action = np.array([0.5, 0, 0, 0, 0, 0], np.float32)
            command = Command(0, message.step, stamp, "pusher", 0, action, 1, self.count)
            self.commands.publish(encode_command(command))

    def moves(self) -> bool:
        return self.probe.until(lambda: self.driver.arm.velocity[0] > 0.2)

    def stops(self, says: str = "") -> bool:
        told = lambda: says in self.probe.message("robot_node")  # noqa: E731
        return self.probe.until(lambda: not self.driver.arm.velocity.any() and told())


@pytest.fixture(scope="module")
def table(module_domain, tmp_path_factory):
    folder = tmp_path_factory.mktemp("robot")
    files = {}
    for dry_run in (False, True):
        files[dry_run] = folder / f"{dry_run}.yaml"
        files[dry_run].write_text(yaml.safe_dump(robot_values(dry_run=dry_run), sort_keys=False))
    (simulated,) = load([str(EXAMPLES / "simulated_arm.py")])
    given = {"robot_node__robot": files[False], "robot_node__autostart": True}
    with graph(RobotNode, simulated.ArmDriver, **given) as probe:
        yield Table(probe, files)


@pytest.mark.parametrize("lost", ["joints", "hand", "red_sphere"])
def test_the_arm_holds_while_a_measurement_is_lost_and_says_which(table, lost):
    assert table.moves()
    table.lost.add(lost)
    assert table.stops("holds: joint_states" if lost == "joints" else f"holds: {lost}")
    table.lost.clear()
    assert table.moves()


def test_the_arm_holds_without_an_agent(table):
    assert table.moves()
    table.agent = False
    assert table.stops("no agent's command")
    table.agent = True
    assert table.moves()


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
