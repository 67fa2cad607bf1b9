"""The parameter files that the nodes come with say every parameter and its default."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

sys.path.append(str(Path(__file__).parents[2] / "docs"))
import reference  # noqa: E402  (a script beside the docs)


@pytest.mark.parametrize("path", reference.files(), ids=lambda path: path.name)
def test_docs_and_parameter_files_say_what_the_settings_are(path):
    """`make reference` writes them."""
    assert path.read_text() == reference.files()[path]


@pytest.mark.parametrize("node", reference.NODES)
def test_a_parameter_file_is_read_as_the_defaults(node):
    content = yaml.safe_load(reference.parameters_yaml(node))[f"/**/{node}"]["ros__parameters"]
    kind = reference.NODES[node]
    assert set(content) == set(kind.paths())
    given = {path: () if value == [""] else value for path, value in content.items()}
    assert kind().changed(**given) == kind()


@pytest.mark.parametrize("node", ["sim_node", "agent_node"])
def test_only_the_learner_needs_torch(node):
    """A robot's computer starts an agent without it: sooner, and in less memory."""
    code = f"import {node}.main, {node}.node, sys; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
