"""Nodes started one by one with the parameter files that come with them."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from helpers.waiting import DEADLINE_S, wait_for

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.graph


def commands(file: str, *nodes: str) -> list[list[str]]:
    """The commands that docs/graph.md shows: each node with a file of its `config` folder."""
    return [[node, "--ros-args", "--params-file", f"{node}/config/{file}"] for node in nodes]


@contextmanager
def running(given: list[list[str]], folder: Path) -> Iterator[dict[str, Path]]:
    """The commands, run in a folder with copies of their parameter files; their logs by name."""
    logs: dict[str, Path] = {}
    processes = []
    try:
        for name, *arguments in given:
            file = Path(arguments[-1])
            (folder / file).parent.mkdir(parents=True)
            shutil.copy(ROOT / file, folder / file)
            logs[name] = folder / f"{name}.log"
            with logs[name].open("w") as output:
                command = [str(Path(sys.executable).with_name(name)), *arguments]
                processes.append(subprocess.Popen(command, cwd=folder, stderr=output))
        yield logs
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait(timeout=DEADLINE_S)
    assert [process.returncode for process in processes] == [0] * len(processes)


def test_three_shells_learn_and_say_so(tmp_path):
    given = commands("learn.yaml", "sim_node", "agent_node", "learner_node")
    with running(given, tmp_path) as logs:
        figures = re.compile(r"frames ([\d,]+) .*updates ([\d,]+) .*weights version")

        def updates() -> int:
            found = figures.findall(logs["learner_node"].read_text())
            return int(found[-1][1].replace(",", "")) if found else 0

        wait_for(lambda: updates() > 0, "a line of progress with updates")
        assert "design 2-L" in logs["sim_node"].read_text()
        wait_for(lambda: "acting" in logs["agent_node"].read_text(), "an agent that acts")
        assert re.search(r"follows learner \w+, run \w+; acts by ", logs["agent_node"].read_text())
    assert "checkpoint: version " in logs["learner_node"].read_text()
    assert (tmp_path / "runs/learn/checkpoint/LATEST").exists()


def test_two_shells_execute_programs(tmp_path):
    from pa_ros.tools.client import client_node
    from pa_ros.tools.send import ProgramSender

    with running(commands("execute.yaml", "sim_node", "agent_node"), tmp_path) as logs:
        wait_for(lambda: "waits for a program" in logs["sim_node"].read_text(), "an idle arena")
        with client_node("sender", "") as node:
            sender = ProgramSender(node)
            assert not sender.send("NEAR(HAND, AND(RED, CUBE))", DEADLINE_S).refused
            assert sender.wait(DEADLINE_S).satisfied
