"""The parameter files that the nodes come with say every parameter and its default."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest
import yaml

from agent_node.config import AgentConfig
from learner_node.config import LearnerNodeConfig
from sim_node.config import SimConfig

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("node", "config"),
    [("sim_node", SimConfig), ("agent_node", AgentConfig), ("learner_node", LearnerNodeConfig)],
)
def test_every_parameter_is_there_with_its_default(node, config):
    content = yaml.safe_load((ROOT / node / "config" / f"{node}.yaml").read_text())
    given = content[f"/**/{node}"]["ros__parameters"]
    defaults = {f.name: [""] if f.default == () else f.default for f in fields(config)}
    assert given == defaults


@pytest.mark.parametrize("node", ["sim_node", "agent_node"])
def test_only_the_learner_needs_torch(node):
    """A robot's computer starts an agent without it: sooner, and in less memory."""
    code = f"import {node}.main, {node}.node, sys; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
