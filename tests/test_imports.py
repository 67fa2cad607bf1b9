"""Imports run one way; rclpy and message packages stay in their rooms (docs/DESIGN.md)."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest

from helpers.sources import PACKAGES, files

TABLE = Path(__file__).parents[1] / "docs/DESIGN.md"


def table_of_rooms(text: str) -> dict[str, set[str]]:
    """The rooms that each room may import, itself included, in the order of the docs' table."""
    allowed: dict[str, set[str]] = {}
    for line in text.splitlines():
        if found := re.fullmatch(r"\| (`[^|]*`) \|[^|]*\| ?([^|]*) ?\|", line):
            rooms = re.findall(r"`([^`]+)`", found[1])
            above = {room for named in found[2].split(",") for room in _named(named, allowed)}
            allowed |= {room: above | set(rooms) for room in rooms}
    return allowed


def _named(text: str, above: Iterable[str]) -> set[str]:
    """Rooms above by what a cell calls them: `core`, `all of learning`, `all above`."""
    name = text.strip()
    if name in ("", "all above"):
        return set(above) if name else set()
    within = f"pa_ros.{name.removeprefix('all of ')}"
    nested = {room for room in above if room.startswith(f"{within}.")}
    found = {within} & set(above) | (nested if name.startswith("all of ") else set())
    assert found, f"{TABLE.name}: a room may import rooms above it, got {name!r}"
    return found


ALLOWED = table_of_rooms(TABLE.read_text().partition("## Observation")[0])
MESSAGES = ("_msgs", "_interfaces", "_srvs", "msgs_schema")
ROS_CLIENT = {
    "pa_ros.ros",
    "pa_ros.tools",
    "pa_ros.console",
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


def room(module: str) -> str:
    """The room of a module, by the longest name in the table; `pa_ros` has the public functions."""
    parts = module.split(".")
    names = (".".join(parts[:n]) for n in range(len(parts), 0, -1))
    return next((name for name in names if name in ALLOWED), "")


def rooms_imported(path: Path) -> set[str]:
    return {room(name) for name in imports(path) if name.split(".")[0] in PACKAGES} - {""}


SOURCES = [(module, path) for module, path in files() if room(module)]


def test_every_file_lies_in_a_room_and_every_room_has_files():
    strays = {module for module, _ in files() if not room(module)}
    assert strays == {"pa_ros", "pa_ros.__main__"}
    assert {room(module) for module, _ in SOURCES} == set(ALLOWED)


def test_a_room_that_is_not_above_is_refused():
    with pytest.raises(AssertionError, match="'upper'"):
        table_of_rooms("| `pa_ros.core` | x | upper |\n| `pa_ros.upper` | y | core |")
    lower = "| `pa_ros.core` | x | |\n| `pa_ros.upper`, `pa_ros.other` | y | core |"
    assert table_of_rooms(lower)["pa_ros.other"] == {"pa_ros.core", "pa_ros.upper", "pa_ros.other"}


def test_packages_do_not_import_the_laboratory():
    for module, path in SOURCES:
        heads = {name.split(".")[0] for name in imports(path)}
        assert not heads & {"laboratory", "chaos", "helpers"}, module


@pytest.mark.parametrize(("module", "path"), SOURCES, ids=[module for module, _ in SOURCES])
def test_imports_run_one_way(module: str, path: Path):
    assert rooms_imported(path) <= ALLOWED[room(module)]


@pytest.mark.parametrize(("module", "path"), SOURCES, ids=[module for module, _ in SOURCES])
def test_rclpy_and_messages_stay_in_their_rooms(module: str, path: Path):
    heads = {name.split(".")[0] for name in imports(path)}
    if room(module) not in ROS_CLIENT:
        assert "rclpy" not in heads
    messages = {head for head in heads if head.endswith(MESSAGES)}
    # The plumbing names message types in its tables of topics and actions; it touches no field.
    if room(module) not in ("pa_ros.wire", "pa_ros.ros"):
        assert not messages


def test_language_needs_the_standard_library_alone():
    for module, path in SOURCES:
        if room(module) == "pa_ros.language":
            assert not {"numpy", "torch", "mujoco"} & {n.split(".")[0] for n in imports(path)}


def test_the_world_needs_numpy_alone():
    for module, path in SOURCES:
        if room(module) == "pa_ros.world":
            assert not {"torch", "mujoco", "gymnasium"} & {n.split(".")[0] for n in imports(path)}


@pytest.mark.parametrize("node", ["agent_node", "learner_node"])
def test_agents_and_learners_need_no_simulator(node: str):
    probe = f"import sys, {node}.node; print('mujoco' in sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True)
    assert loaded.stdout == "False\n", loaded.stderr
