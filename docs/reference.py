"""Writes what the docs and the nodes' parameter files say of settings, from the settings.

`make reference` runs it; a test holds every file to it.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import yaml

from agent_node.config import AgentConfig
from learner_node.config import LearnerNodeConfig
from pa_ros.core.settings import Leaf, Settings
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.networks.config import NetworkConfig
from sim_node.config import SimConfig

ROOT = Path(__file__).parents[1]
NODES: dict[str, type[Settings]] = {
    "sim_node": SimConfig,
    "agent_node": AgentConfig,
    "learner_node": LearnerNodeConfig,
}
TABLES: dict[str, tuple[str, type[Settings]]] = {  # marker: file, settings
    "learner": ("docs/learning.md", DPGConfig),
    "network": ("docs/learning.md", NetworkConfig),
    **{node: ("docs/graph.md", kind) for node, kind in NODES.items()},
}


def parameters_yaml(node: str) -> str:
    """A parameter file with every default, each under what it means."""
    lines = [
        f"# Parameters of {node} with their defaults, written by `make reference`.",
        f"/**/{node}:",
        "  ros__parameters:",
    ]
    for leaf in NODES[node].leaves():
        default = list(leaf.default or ("",)) if isinstance(leaf.default, tuple) else leaf.default
        value = yaml.safe_dump(default, default_flow_style=True, width=1000).partition("\n")[0]
        lines += [f"    # {leaf.description}", f"    {leaf.path}: {value}"]
    return "\n".join(lines) + "\n"


def table(kind: type[Settings]) -> str:
    """A row for each setting; a vocabulary is no setting that one gives."""
    rows = ["| Name | Default | Expected | Meaning |", "|---|---|---|---|"]
    rows += [_row(leaf) for leaf in kind.leaves() if leaf.default is not ...]
    return "\n".join(rows)


def _row(leaf: Leaf) -> str:
    default = leaf.default
    shown = default if isinstance(default, str) else json.dumps(default)
    cells = (f"`{leaf.path}`", shown or "(empty)", leaf.expected, leaf.description)
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def files() -> dict[Path, str]:
    """Every file that says something of settings, as it has to be."""
    written = {ROOT / n / "config" / f"{n}.yaml": parameters_yaml(n) for n in NODES}
    for marker, (name, kind) in TABLES.items():
        path = ROOT / name
        text = written.get(path) or path.read_text()
        begin, end = f"<!-- settings: {marker} -->", "<!-- end -->"
        pattern = f"{re.escape(begin)}.*?{re.escape(end)}"
        if begin not in text:
            raise SystemExit(f"{name}: expected a line {begin}, found none")
        block = f"{begin}\n{table(kind)}\n{end}"
        written[path] = re.sub(pattern, lambda _, new=block: new, text, flags=re.DOTALL)  # type: ignore[misc]
    return written


if __name__ == "__main__":
    for path, content in files().items():
        path.write_text(content)
