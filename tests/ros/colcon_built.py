"""What colcon has built and installed under build/colcon does its work: `make colcon`."""

import json
import os
import re
import signal
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from helpers.installed import ORIGINS, PACKAGES, ROOT, elsewhere, missing
from helpers.waiting import DEADLINE_S

BUILT = ROOT / "build/colcon"
INSTALLED, PYTHON = BUILT / "install", BUILT / "venv"
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


def test_code_messages_libraries_and_engine_come_from_colcon(run: Command, tmp_path: Path):
    (tmp_path / "origins.py").write_text(ORIGINS)
    assert elsewhere(json.loads(run("python origins.py")), INSTALLED) == []


@pytest.mark.parametrize("package", PACKAGES)
def test_shared_files_are_installed(package: str):
    assert missing(package, INSTALLED / package / "share" / package, "msg/*.msg") == []


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
