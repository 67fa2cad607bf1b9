"""Nodes started one by one with the parameter files that come with them."""

import re
import shutil
import sys
from pathlib import Path

import pytest

from helpers.processes import running
from helpers.waiting import wait_for

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.graph


def test_three_nodes_started_as_the_docs_show_learn_and_save(tmp_path: Path) -> None:
    """Each with `learn.yaml` of its `config` folder, as in docs/graph.md."""
    commands = []
    for name in ("sim_node", "agent_node", "learner_node"):
        file = f"{name}/config/learn.yaml"
        (tmp_path / file).parent.mkdir(parents=True)
        shutil.copy(ROOT / file, tmp_path / file)
        program = str(Path(sys.executable).with_name(name))
        commands.append([program, "--ros-args", "--params-file", file])
    learning = re.compile(r"\]: learning$", re.MULTILINE)
    with running(tmp_path, *commands, cwd=tmp_path) as (sim, agent, learner):
        wait_for(lambda: learning.search(learner.read_text()), "a learner that learns")
        wait_for(lambda: "acting" in agent.read_text(), "an agent that acts")
    assert "design 2-L" in sim.read_text()
    assert "checkpoint: version " in learner.read_text()
    assert (tmp_path / "runs/learn/checkpoint/LATEST").exists()
