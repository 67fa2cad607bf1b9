"""The launch file's structure, by a stand-in for `launch`; and that what it starts does start."""

import os
import sys
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

ROOT = Path(__file__).parents[2]
GRAPH = ROOT / "pa_ros/launch/graph.launch.py"


@pytest.fixture(autouse=True)
def exported(monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)


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
def test_the_launched_graph_executes_a_program(tmp_path):
    nodes = described(GRAPH).started(mode="execute", namespace="left")
    commands = [node_command(node.executable, *words) for node, words in nodes]
    with running(tmp_path, *commands), client_node("test", "left") as node:
        sender = ProgramSender(node, partial(spin_until, node))
        assert not sender.send("NEAR(HAND, AND(RED, CUBE))", DEADLINE_S).refused
        assert sender.wait(DEADLINE_S).satisfied
