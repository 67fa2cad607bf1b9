"""What ROS's own tools look up where the packages are installed; launch files, by a stand-in."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from functools import partial
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory

from helpers.processes import node_command, running
from helpers.stand_in_launch import described
from helpers.waiting import DEADLINE_S
from pa_ros.ros.executor import spin_until
from pa_ros.tools.client import client_node
from pa_ros.tools.send import ProgramSender

NODES = ("sim_node", "agent_node", "learner_node")
ROOT = Path(__file__).parents[2]
GRAPH = ROOT / "pa_ros/launch/graph.launch.py"


@pytest.fixture(autouse=True)
def exported(monkeypatch):
    """The one export that README asks for."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)


@pytest.mark.parametrize("package", [*NODES, "pa_ros", "msgs_schema"])
def test_each_package_is_in_the_ament_index(package):
    assert get_package_prefix(package) == sys.prefix
    manifest = ET.parse(Path(get_package_share_directory(package)) / "package.xml")
    assert manifest.findtext("name") == package


@pytest.mark.parametrize("node", NODES)
def test_parameter_files_are_installed(node):
    installed = Path(get_package_share_directory(node)) / "config"
    files = sorted(path.name for path in (ROOT / node / "config").glob("*.yaml"))
    assert files and files == sorted(path.name for path in installed.iterdir())


@pytest.mark.graph
def test_ros2_run_finds_each_executable_and_a_nodes_prints_its_help():
    for package in (*NODES, "pa_ros"):
        executable = Path(get_package_prefix(package)) / "lib" / package / package
        assert os.access(executable, os.X_OK)
    command = [f"{get_package_prefix('sim_node')}/lib/sim_node/sim_node", "--help"]
    told = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S, cwd="/")
    assert told.returncode == 0 and told.stderr == ""
    assert told.stdout.startswith("usage: sim_node ")
    assert "  seed [0]\n      an integer of at least 0: of " in told.stdout


def test_it_is_installed_and_describes_its_arguments():
    installed = Path(get_package_share_directory("pa_ros")) / "launch" / GRAPH.name
    assert installed.read_text() == GRAPH.read_text()
    description = described(GRAPH)
    assert all(one.description for one in description.arguments)
    for node, words in description.started():
        folder = Path(get_package_prefix(node.package)) / "lib" / node.package
        assert os.access(folder / node.executable, os.X_OK)
        assert Path(words[words.index("--params-file") + 1]).is_file()
        assert node.output == "screen"


def test_the_mode_chooses_nodes_and_parameter_files():
    description = described(GRAPH)
    nodes = ["sim_node", "agent_node", "learner_node"]
    for mode, names in (("learn", nodes), ("execute", nodes[:2])):
        started = description.started(mode=mode)
        assert [node.name for node, _ in started] == names
        for node, words in started:
            file = words[words.index("--params-file") + 1]
            assert file.endswith(f"{node.name}/config/{mode}.yaml")


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
def test_the_launched_graph_executes_a_program(tmp_path):
    nodes = described(GRAPH).started(mode="execute", namespace="left")
    commands = [node_command(node.executable, *words) for node, words in nodes]
    with running(tmp_path, *commands), client_node("test", "left") as node:
        sender = ProgramSender(node, partial(spin_until, node))
        assert not sender.send("NEAR(HAND, AND(RED, CUBE))", DEADLINE_S).refused
        assert sender.wait(DEADLINE_S).satisfied
