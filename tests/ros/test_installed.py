"""What ROS's own tools look up in the environment that the packages are installed in."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory

from helpers.waiting import DEADLINE_S

NODES = ("sim_node", "agent_node", "learner_node")
ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def exported(monkeypatch):
    """The one export that README asks for."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)


@pytest.mark.parametrize("package", [*NODES, "pa_ros", "msgs_schema"])
def test_each_package_is_in_the_ament_index(package):
    assert get_package_prefix(package) == sys.prefix
    described = ET.parse(Path(get_package_share_directory(package)) / "package.xml")
    assert described.findtext("name") == package


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
