"""Imports run one way; rclpy and message packages stay in their rooms (docs/DESIGN.md)."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from sources import PACKAGES, files, room

CORE = {"pa_ros.core", "pa_ros"}  # `pa_ros` itself holds the version alone
LANGUAGE = CORE | {"pa_ros.language"}
WORLD = LANGUAGE | {"pa_ros.world"}
NETWORKS = WORLD | {"pa_ros.networks"}
LEARNING = NETWORKS | {"pa_ros.acting", "pa_ros.learning", "pa_ros.native"}
ARENA = WORLD | {"pa_ros.arena"}
WIRE = CORE | {"pa_ros.wire"}
PROVENANCE = LEARNING | ARENA | WIRE | {"pa_ros.provenance"}
EVALUATION = LEARNING | ARENA | {"pa_ros.evaluation", "pa_ros.provenance"}
BAGS = EVALUATION | PROVENANCE | {"pa_ros.bags"}
ROS = WIRE | {"pa_ros.ros"}
TOOLS = BAGS | ROS | {"pa_ros.tools"}
NODES = LEARNING | ARENA | EVALUATION | PROVENANCE | ROS
ALLOWED = {
    "pa_ros.core": CORE,
    "pa_ros.language": LANGUAGE,
    "pa_ros.world": WORLD,
    "pa_ros.networks": NETWORKS,
    "pa_ros.acting": LEARNING,
    "pa_ros.native": LEARNING,
    "pa_ros.learning": LEARNING,
    "pa_ros.arena": ARENA,
    "pa_ros.evaluation": EVALUATION,
    "pa_ros.wire": WIRE,
    "pa_ros.provenance": PROVENANCE,
    "pa_ros.bags": BAGS,
    "pa_ros.ros": ROS,
    "pa_ros.tools": TOOLS,
    "pa_ros.benchmarks": TOOLS | {"pa_ros.benchmarks"},
    "pa_ros.cli": TOOLS | {"pa_ros.benchmarks", "pa_ros.cli"},
    "sim_node": NODES | {"sim_node"},
    "agent_node": NODES | {"agent_node"},
    "learner_node": NODES | {"learner_node"},
}
MESSAGES = ("_msgs", "_interfaces", "_srvs", "msgs_schema")
ROS_CLIENT = {
    "pa_ros.ros",
    "pa_ros.tools",
    "pa_ros.benchmarks",
    "sim_node",
    "agent_node",
    "learner_node",
}


def imports(path: Path) -> set[str]:
    """Modules that a file imports, wherever in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert node.module is not None
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def rooms_imported(path: Path) -> set[str]:
    known = set(ALLOWED) | {"pa_ros"}
    ours = {room(name) for name in imports(path) if name.split(".")[0] in PACKAGES}
    return {name if name in known else "pa_ros" for name in ours}


SOURCES = [(module, path) for module, path in files() if room(module) in ALLOWED]


def test_every_room_is_known():
    rooms = {room(module) for module, path in files() if len(module.split(".")) > 2}
    assert rooms <= set(ALLOWED)
    assert len(SOURCES) > 50


@pytest.mark.parametrize(("module", "path"), SOURCES, ids=[module for module, _ in SOURCES])
def test_imports_run_one_way(module: str, path: Path):
    assert rooms_imported(path) <= ALLOWED[room(module)]


@pytest.mark.parametrize(("module", "path"), SOURCES, ids=[module for module, _ in SOURCES])
def test_rclpy_and_messages_stay_in_their_rooms(module: str, path: Path):
    heads = {name.split(".")[0] for name in imports(path)}
    if room(module) not in ROS_CLIENT:
        assert "rclpy" not in heads
    messages = {head for head in heads if head.endswith(MESSAGES)}
    if room(module) == "pa_ros.ros":
        messages -= {"rcl_interfaces"}  # what a parameter callback returns
    if room(module) != "pa_ros.wire":
        assert not messages


def test_language_needs_the_standard_library_alone():
    for module, path in SOURCES:
        if room(module) == "pa_ros.language":
            assert not {"numpy", "torch", "mujoco"} & {n.split(".")[0] for n in imports(path)}


def test_the_world_needs_numpy_alone():
    for module, path in SOURCES:
        if room(module) == "pa_ros.world":
            assert not {"torch", "mujoco", "gymnasium"} & {n.split(".")[0] for n in imports(path)}
