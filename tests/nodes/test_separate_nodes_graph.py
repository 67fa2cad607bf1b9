"""Nodes started one by one with the parameter files that come with them."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.waiting import DEADLINE_S, wait_for

ROOT = Path(__file__).parents[2]
NODES = ("sim_node", "agent_node", "learner_node")
pytestmark = pytest.mark.graph


def test_three_nodes_started_as_the_docs_show_learn_and_save(tmp_path: Path) -> None:
    """Each with `learn.yaml` of its `config` folder, as in docs/graph.md."""
    logs = {name: tmp_path / f"{name}.log" for name in NODES}
    processes = []
    try:
        for name, log in logs.items():
            file = f"{name}/config/learn.yaml"
            (tmp_path / file).parent.mkdir(parents=True)
            shutil.copy(ROOT / file, tmp_path / file)
            program = str(Path(sys.executable).with_name(name))
            command = [program, "--ros-args", "--params-file", file]
            with log.open("w") as output:
                processes.append(subprocess.Popen(command, cwd=tmp_path, stderr=output))
        learning = re.compile(r"\]: learning$", re.MULTILINE)
        wait_for(lambda: learning.search(logs["learner_node"].read_text()), "a learner that learns")
        wait_for(lambda: "acting" in logs["agent_node"].read_text(), "an agent that acts")
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait(timeout=DEADLINE_S)
    assert [process.returncode for process in processes] == [0, 0, 0]
    assert "design 2-L" in logs["sim_node"].read_text()
    assert "checkpoint: version " in logs["learner_node"].read_text()
    assert (tmp_path / "runs/learn/checkpoint/LATEST").exists()
