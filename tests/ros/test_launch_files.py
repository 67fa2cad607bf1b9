"""The launch files' structure, by a stand-in for `launch`; and that what they start does start."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory

from helpers.stand_in_launch import described
from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.tools.client import client_node

ROOT = Path(__file__).parents[2]
FILES = sorted(ROOT.glob("*/launch/*.launch.py"))
GRAPH = ROOT / "pa_ros/launch/graph.launch.py"


@pytest.fixture(autouse=True)
def exported(monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_a_launch_file_is_installed_and_describes_its_arguments(path):
    package = path.parts[-3]
    installed = Path(get_package_share_directory(package)) / "launch" / path.name
    assert installed.read_text() == path.read_text()
    description = described(path)
    assert all(one.description for one in description.arguments)
    for node, words in description.started():
        folder = Path(get_package_prefix(node.package)) / "lib" / node.package
        assert os.access(folder / node.executable, os.X_OK)
        assert Path(words[words.index("--params-file") + 1]).is_file()
        assert node.output == "screen"


def test_the_graph_learns_or_executes():
    description = described(GRAPH)
    names = {
        mode: [node.name for node, _ in description.started(mode=mode)]
        for mode in ("learn", "execute")
    }
    assert names["learn"] == ["sim_node", "agent_node", "learner_node"]
    assert names["execute"] == ["sim_node", "agent_node"]
    for mode in names:
        for node, words in description.started(mode=mode):
            assert words[words.index("--params-file") + 1].endswith(
                f"{node.name}/config/{mode}.yaml"
            )


def test_namespace_parameters_time_and_remaps_reach_every_node():
    description = described(GRAPH)
    given = {"namespace": "left", "program": "wanted", "log_level": "warn", "mode": "learn"}
    mine = "/my/agent.yaml"
    for node, words in description.started(**given, use_sim_time="true", agent_params=mine):
        line = " ".join(words)
        assert "__ns:=/left" in line and "program:=wanted" in line and "/clock:=clock" in line
        assert "--log-level warn" in line and node.on_exit is not None
        assert ("use_sim_time:=true" in line) == (node.name != "sim_node")
        assert (mine in line) == (node.name == "agent_node")


@pytest.mark.graph
def test_what_the_graphs_launch_file_starts_executes_programs():
    started = []
    try:
        for node, words in described(GRAPH).started(mode="execute", namespace="left"):
            command = [sys.executable, "-m", f"{node.executable}.main", *words]
            started.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
        with client_node("test", "left") as node:
            wanted = {"/left/sim_node", "/left/agent_node"}

            def named() -> set[str]:
                there = node.get_node_names_and_namespaces()
                return {f"{where}/{name}" for name, where in there}

            wait_for(lambda: wanted <= named(), "both nodes")
        command = [sys.executable, "-m", "pa_ros", "send", "NEAR(HAND, AND(RED, CUBE))", "--wait"]
        sent = subprocess.run(
            [*command, "--namespace", "left", "--timeout", "60"],
            capture_output=True,
            text=True,
            timeout=DEADLINE_S,
        )
        assert sent.returncode == 0, sent.stderr
        assert "satisfied: distance" in sent.stdout and "RED CUBE 1.00" in sent.stdout
    finally:
        for process in started:
            process.terminate()
        for process in started:
            assert process.wait(DEADLINE_S) == 0
