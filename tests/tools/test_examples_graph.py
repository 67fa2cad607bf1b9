"""The runnable examples of docs/robot.md execute programs, and are as short as they claim."""

import sys
from pathlib import Path

import pytest
import yaml

from helpers.processes import node_command, running
from pa_ros.cli.main import main

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs/examples"


def node(name: str) -> list[str]:
    parameters = str(ROOT / name / "config/execute.yaml")
    return node_command(name, "--ros-args", "--params-file", parameters)


def example(name: str) -> list[str]:
    return [sys.executable, str(EXAMPLES / name)]


def robot_node(folder: Path) -> list[str]:
    """robot_node with the example's robot.yaml, but poses from tf, and without a dry run."""
    robot = yaml.safe_load((EXAMPLES / "robot.yaml").read_text())
    robot["dry_run"] = False
    for name, thing in robot["objects"].items():
        robot["objects"][name] = {"words": thing["words"], "frame": name}
    file = folder / "robot.yaml"
    file.write_text(yaml.safe_dump(robot, sort_keys=False))
    given = ["-p", f"robot:={file}", "-p", "autostart:=true"]
    return node_command("sim_node.robot", "--ros-args", *given)


@pytest.mark.graph
@pytest.mark.parametrize("robot", [True, False], ids=["robot", "controller"])
def test_an_example_executes_a_program_and_the_arm_refuses_another(robot, tmp_path):
    of_robot = [example("simulated_arm.py"), robot_node(tmp_path), node("agent_node")]
    nodes = of_robot if robot else [node("sim_node"), example("controller.py")]
    programs = {
        "NEAR(HAND, AND(RED, CUBE))": 0,
        "THEN(NEAR(HAND, SPHERE), NEAR(HAND, CYLINDER))": 0,
    }
    programs |= {"NEAR(HAND, RAD)": 2} if robot else {}
    with running(tmp_path, *nodes):
        for program, status in programs.items():
            assert main(["send", program, "--wait", "--timeout", "60"]) == status, program
