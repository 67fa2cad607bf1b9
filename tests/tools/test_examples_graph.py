"""The runnable examples of docs/robot.md execute programs, and are as short as they claim."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from waiting import DEADLINE_S

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs/examples"


def node(name: str) -> list[str]:
    parameters = str(ROOT / name / "config/execute.yaml")
    return [sys.executable, "-m", f"{name}.main", "--ros-args", "--params-file", parameters]


def example(name: str) -> list[str]:
    return [sys.executable, str(EXAMPLES / name)]


@pytest.mark.graph
@pytest.mark.parametrize(
    "nodes",
    [
        [example("robot_driver.py"), node("agent_node")],
        [node("sim_node"), example("controller.py")],
    ],
    ids=["robot", "controller"],
)
def test_an_example_executes_programs_and_refuses_others(nodes):
    started = [subprocess.Popen(one, stderr=subprocess.PIPE, text=True) for one in nodes]
    try:
        for program, status in (
            ("NEAR(HAND, AND(RED, CUBE))", 0),
            ("NEAR(HAND, AND(GREEN, CYLINDER))", 0),
            ("NEAR(HAND, RAD)", 2),
        ):
            command = [sys.executable, "-m", "pa_ros", "send", program, "--wait", "--timeout", "60"]
            sent = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S)
            assert sent.returncode == status, (program, sent.stdout, sent.stderr)
    finally:
        for process in started:
            process.terminate()
        ended = [
            (process.communicate(timeout=DEADLINE_S)[1], process.returncode) for process in started
        ]
    assert [status for _, status in ended] == [0, 0], ended


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_an_example_is_short_and_named_in_the_docs(path):
    code = [line for line in path.read_text().splitlines() if line.strip()]
    assert len(code) < 65
    assert f"examples/{path.name}" in (ROOT / "docs/robot.md").read_text()
