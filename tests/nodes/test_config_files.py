"""The parameter files that the nodes come with say every parameter, and are what they say."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

sys.path.append(str(Path(__file__).parents[2] / "docs"))
import reference  # noqa: E402  (a script beside the docs)

WRITTEN = reference.files()  # before a test registers things of its own


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: "/".join(path.parts[-3:]))
def test_docs_and_parameter_files_say_what_the_settings_are(path):
    """`make reference` writes them."""
    assert path.read_text() == WRITTEN[path]


FILES = [(purpose, node) for purpose, nodes in reference.PURPOSES.items() for node in nodes]


@pytest.mark.parametrize(("purpose", "node"), FILES)
def test_a_parameter_file_is_read_as_the_defaults_but_for_what_it_names(purpose, node):
    text = reference.parameters_yaml(node, purpose)
    content = yaml.safe_load(text)[f"/**/{node}"]["ros__parameters"]
    kind, changed = reference.NODES[node], reference.PURPOSES[purpose][node]
    described = {leaf.path for leaf in kind.leaves()}
    assert set(content) == {p for p in described if not p.startswith(reference.OF_RECIPES)}
    given = {path: () if value == [""] else value for path, value in content.items()}
    assert kind().changed(**given) == kind().changed(**changed)
    assert all(path in text.partition("/**")[0] for path in changed)


@pytest.mark.parametrize("node", ["sim_node", "agent_node"])
def test_only_the_learner_needs_torch(node):
    """A robot's computer starts an agent without it: sooner, and in less memory."""
    code = f"import {node}.main, {node}.node, sys; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
