"""A learner that is killed while an arm of robot_node learns."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from agent_node.node import AgentNode
from helpers.graph import SMALL, graph
from helpers.robots import SIMULATED, learning_robot, pressed
from pa_ros.ros import topics
from sim_node.robot.node import RobotNode

pytestmark = pytest.mark.graph


def learner_process(out: Path, *more: str) -> subprocess.Popen[Any]:
    values = {**SMALL, "checkpoint_every_frames": 20, "out": out}
    given = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    command = [sys.executable, "-P", "-m", "learner_node.main", "--ros-args", *given, *more]
    return subprocess.Popen(command)


def test_a_learner_that_is_killed_stops_the_arm_and_continues_from_its_checkpoint(
    tmp_path: Path,
) -> None:
    file = learning_robot(tmp_path, dry_run=False)
    robot = {"robot_node__robot": file, "robot_node__autostart": True}
    agent = {"agent_node__learning": True, "agent_node__weights": "topic"}
    with graph(SIMULATED.ArmDriver, RobotNode, AgentNode, **robot, **agent) as probe:
        learner = learner_process(tmp_path / "run")
        try:
            assert probe.until(lambda: len(probe.nodes[1].arm.measured) == 1)
            assert pressed(probe, topics.RESUME).success
            assert probe.learns(25)
            learner.kill()
            learner.wait()
            assert probe.until(lambda: not probe.nodes[0].arm.velocity.any())
            frames = float(probe.value("learner_node", "frames"))
            learner = learner_process(tmp_path / "run", "-p", "resume:=true")
            assert probe.until(lambda: probe.value("learner_node", "version") != "")
            assert probe.learns(5)
            assert float(probe.value("learner_node", "frames")) > frames
        finally:
            learner.kill()
            learner.wait()
