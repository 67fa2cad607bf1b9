"""What colcon has built and installed under build/colcon does its work: `make colcon`."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from helpers.waiting import DEADLINE_S

ROOT = Path(__file__).parents[2]
BUILT = ROOT / "build/colcon"
INSTALLED, PYTHON = BUILT / "install", BUILT / "venv"
PACKAGES = ("sim_node", "agent_node", "learner_node", "pa_ros", "msgs_schema")
LEARNED = re.compile(r"\bversion [1-9]")
Command = Callable[..., str]


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Of a shell in which nothing of this process' own environment was set up."""
    kept = {name: os.environ[name] for name in ("HOME", "ROS_DOMAIN_ID") if name in os.environ}
    path = f"{PYTHON}/bin:/usr/bin:/bin"
    return {**kept, "PATH": path, "AMENT_PREFIX_PATH": str(PYTHON), "ROS_LOG_DIR": str(tmp_path)}


def sourced(line: str) -> list[str]:
    """A line for a shell that has sourced what colcon wrote."""
    return ["bash", "-c", f". '{INSTALLED}/setup.bash' && exec {line}"]


@pytest.fixture
def run(environment: dict[str, str], tmp_path: Path) -> Command:
    def run(line: str) -> str:
        done = subprocess.run(
            sourced(line),
            env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=DEADLINE_S,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


ORIGINS = """
import importlib, json
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from msgs_schema.msg import Program
Program.__class__.__import_type_support__()
with open("/proc/self/maps") as maps:
    mapped = {line.split()[-1] for line in maps if "libmsgs_schema" in line}
from pa_ros.native.library import level, library
names = NAMES
found = [get_package_prefix(n) for n in names] + [get_package_share_directory(n) for n in names]
files = [importlib.import_module(n).__path__[0] for n in names]
print(json.dumps({"level": level(), "places": [*found, *files, *mapped, library().__file__]}))
"""


def test_code_messages_libraries_and_engine_come_from_colcon(run: Command, tmp_path: Path):
    (tmp_path / "origins.py").write_text(ORIGINS.replace("NAMES", repr(PACKAGES)))
    told = json.loads(run("python origins.py"))
    assert len(told["places"]) > 3 * len(PACKAGES) + 1  # some libraries, too
    assert [path for path in told["places"] if not path.startswith(str(INSTALLED))] == []
    assert told["level"] in ("generic", "x86-64-v3", "x86-64-v4")


@pytest.mark.parametrize("package", PACKAGES)
def test_shared_files_are_installed(package: str):
    shared = [
        path.relative_to(ROOT / package)
        for pattern in ("package.xml", "launch/*.py", "config/*.yaml", "msg/*.msg")
        for path in (ROOT / package).glob(pattern)
    ]
    share = INSTALLED / package / "share" / package
    assert shared and [path for path in shared if not (share / path).is_file()] == []


@pytest.mark.graph
@pytest.mark.parametrize("package", PACKAGES[:-1])
def test_ros2_run_finds_each_executable(package: str, run: Command):
    told = run(f"'{INSTALLED / package}/lib/{package}/{package}' --help")
    assert told.startswith(f"usage: {package} ")


def test_the_shipped_agent_scores_well(run: Command, tmp_path: Path):
    program = INSTALLED / "pa_ros/lib/pa_ros/pa_ros"
    options = "--checkpoint shipped:3-D --condition eval --episodes 5 --json score.json"
    run(f"'{program}' eval {options}")
    assert json.loads((tmp_path / "score.json").read_text())["eval.normalized"] > 0.8


@pytest.mark.graph
def test_a_graph_learns_in_lockstep(environment: dict[str, str], tmp_path: Path):
    """Arena, agent and learner: the table of figures, line by line, counts frames."""
    program = INSTALLED / "pa_ros/lib/pa_ros/pa_ros"
    launch = sourced(f"'{program}' launch --params train_2l --out run")
    with subprocess.Popen(
        launch, env=environment, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True,
    ) as process:  # fmt: skip
        late = threading.Timer(DEADLINE_S, process.kill)
        late.start()
        said: list[str] = []
        try:
            assert process.stdout is not None
            for line in process.stdout:
                said.append(line)
                if LEARNED.search(line) and not any(map(LEARNED.search, said[:-1])):
                    process.send_signal(signal.SIGINT)
            process.wait()
        finally:
            late.cancel()
            process.kill()
    assert any(map(LEARNED.search, said)), "".join(said)
    assert process.returncode == 0, "".join(said)


def test_layouts_are_installed():
    there = {path.name for path in (INSTALLED / "pa_ros/share/pa_ros/layouts").iterdir()}
    assert there == {path.name for path in (ROOT / "pa_ros/pa_ros/layouts").iterdir()}
