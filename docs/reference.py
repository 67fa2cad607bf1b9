"""Writes what the docs and the nodes' parameter files say of settings, from the settings.

`make reference` runs it; a test holds every file to it.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import yaml

from agent_node.config import AgentConfig
from learner_node.config import LearnerNodeConfig
from pa_ros.arena import PRESETS, ArenaChoice, ArenaConfig
from pa_ros.core.settings import Leaf, Settings
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.algorithms.td3.config import TD3Config
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.recipes import RECIPES, LearningSettings
from pa_ros.networks.config import NetworkSettings
from sim_node.config import SimConfig
from sim_node.robot.settings import GripperSettings, LessonSettings, RobotSettings

ROOT = Path(__file__).parents[1]
EXTENDING = ROOT / "docs/extending.md"
NODES: dict[str, type[Settings]] = {
    "sim_node": SimConfig,
    "agent_node": AgentConfig,
    "learner_node": LearnerNodeConfig,
}
OF_RECIPES = ("learner.", "network.")  # described once, in docs/learning.md
# By what the nodes are started for: what each node's file says differently from the defaults.
PURPOSES: dict[str, dict[str, dict[str, object]]] = {
    "learn": {
        "sim_node": {},
        "agent_node": {"learning": True},
        "learner_node": {"out": "runs/learn"},
    },
    "execute": {
        "sim_node": {"mode": "real_time", "program_source": "topic", "design": "3-D", "seed": 2},
        "agent_node": {"weights": "checkpoint", "checkpoint": "shipped:3-D"},
    },
}
SETS: dict[str, dict[str, dict[str, Any]]] = {  # marker: named sets of values, by path
    "arena": {name: PRESETS[name].flat() for name in ("paper", "fast", "robot", "push", "hold")},
    "learner": {name: LearningSettings(recipe=name).learner.flat() for name in RECIPES},
    "td3": {
        name: LearningSettings(recipe=name, algorithm="td3").learner.flat() for name in RECIPES
    },
    "network": {name: LearningSettings(recipe=name).network.flat() for name in RECIPES},
}
TABLES: dict[str, tuple[str, type[Settings]]] = {  # marker: file, settings
    "arena": ("docs/arena.md", ArenaConfig),
    "learner": ("docs/learning.md", DPGConfig),
    "td3": ("docs/learning.md", TD3Config),
    "network": ("docs/learning.md", NetworkSettings),
    "robot": ("docs/robot.md", RobotSettings),
    "gripper": ("docs/robot.md", GripperSettings),
    "lessons": ("docs/robot.md", LessonSettings),
}


def parameters_yaml(node: str, purpose: str) -> str:
    """A parameter file with every parameter, each under what it means."""
    changed = PURPOSES[purpose][node]
    lines = [
        f"# Parameters of {node} to {purpose}, with the others' files {purpose}.yaml.",
        "# Written by `make reference`; every parameter is here, with its default"
        f"{' except for ' + ', '.join(changed) if changed else ''}.",
        f"/**/{node}:",
        "  ros__parameters:",
    ]
    own = [leaf for leaf in NODES[node].leaves() if not leaf.path.startswith(OF_RECIPES)]
    others = [leaf for leaf in NODES[node].leaves() if leaf.path.startswith(OF_RECIPES)]
    for leaf in own:
        default = changed.get(leaf.path, leaf.default)
        default = list(default or ("",)) if isinstance(default, tuple) else default
        value = yaml.safe_dump(default, default_flow_style=True, width=1000).partition("\n")[0]
        lines += [f"    # {leaf.description}{values(leaf)}", f"    {leaf.path}: {value}"]
    if others:
        lines += [
            "    #",
            "    # Settings of learning, with the values of the usual recipe (docs/learning.md).",
            "    # What is given here counts more than the recipe.",
        ]
    for leaf in others:
        meaning = f"{leaf.description}{values(leaf)}"
        lines += [f"    # {meaning}", f"    # {leaf.path}: {shown(leaf.default)}"]
    return "\n".join(lines) + "\n"


def values(leaf: Leaf) -> str:
    """What a parameter may be, after its meaning; nothing where any text will do."""
    expected = brief(leaf.expected)
    return "" if expected == "text" else f" ({expected})"


def table(kind: type[Settings], sets: dict[str, dict[str, Any]]) -> str:
    """A row for each setting, with its value in each named set.

    Tables of learning have only the settings that a recipe changes, TD3's those that DPG lacks, and
    the robot's those that sim_node lacks and that have no table of their own.
    """
    of_learning = issubclass(kind, (LearnerConfig, NetworkSettings))
    expected = [] if of_learning else ["Expected"]
    names = ["Name", "Default", *(f"`{name}`" for name in sets), *expected, "Meaning"]
    rows = [f"| {' | '.join(names)} |", "|---" * len(names) + "|"]
    shared = {leaf.path for leaf in LearnerConfig.leaves()} if kind is TD3Config else set()
    leaves = list(kind.leaves())
    if kind is RobotSettings:
        shared = {leaf.path for leaf in ArenaChoice.leaves()} | {
            "gripper",
            "learning",
        }  # with tables
    leaves = [leaf for leaf in leaves if leaf.path not in shared]
    for leaf in leaves:
        name = f"`{kind.SECTION}.{leaf.path}`" if of_learning else f"`{leaf.path}`"
        default = shown(leaf.default) if leaf.default is not ... else ""
        found = [shown(values.get(leaf.path, leaf.default)) for values in sets.values()]
        other = ["" if value == default else value for value in found]
        about = [brief(leaf.expected)] if expected else []
        if default and (any(other) or not of_learning or kind is TD3Config):
            rows.append(_row(name, default, *other, *about, leaf.description))
    return "\n".join(rows)


def _row(*cells: str) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def brief(expected: str) -> str:
    """What a value must be, in the form of a table: `0.01 … 1`, `integer ≥ 0`, `text`."""
    for pattern, short in (
        (r"^(?:one|some) of \[(.*)\]$", r"\1"),
        (r"^an? ", ""),
        (r"^number(?= )", ""),
        (r" of at least ", r" ≥ "),
        (r" in ", r" "),
    ):
        expected = re.sub(pattern, short, expected)
    return expected.strip().replace("'", "")


def shown(value: Any) -> str:
    """A value in a table; joints that are all alike once."""
    if isinstance(value, tuple) and len(set(value)) == 1 < len(value):
        return f"{shown(value[0])} each"
    if isinstance(value, tuple):
        return ", ".join(map(shown, value)) or "(empty)"
    if isinstance(value, bool) or not isinstance(value, (str, float)):
        return json.dumps(value)
    return (value if isinstance(value, str) else f"{value:.4g}") or "(empty)"


def files() -> dict[Path, str]:
    """Every file that says something of settings, as it has to be."""
    written = {
        ROOT / node / "config" / f"{purpose}.yaml": parameters_yaml(node, purpose)
        for purpose, nodes in PURPOSES.items()
        for node in nodes
    }
    for marker, (name, kind) in TABLES.items():
        path = ROOT / name
        text = written.get(path) or path.read_text()
        begin, end = f"<!-- settings: {marker} -->", "<!-- end -->"
        pattern = f"{re.escape(begin)}.*?{re.escape(end)}"
        if begin not in text:
            raise SystemExit(f"{name}: expected a line {begin}, found none")
        block = f"{begin}\n{table(kind, SETS.get(marker, {}))}\n{end}"
        written[path] = re.sub(pattern, lambda _, new=block: new, text, flags=re.DOTALL)  # type: ignore[misc]
    written[EXTENDING] = with_examples(EXTENDING.read_text())
    return written


def with_examples(text: str) -> str:
    """A page whose marked places hold the text of the files that they name, where these exist."""

    def block(found: re.Match[str]) -> str:
        path = ROOT / found[1]
        code = f"```python\n{path.read_text()}```\n" if path.exists() else ""
        return f"<!-- file: {found[1]} -->\n{code}<!-- end -->"

    return re.sub(r"<!-- file: (\S+) -->\n.*?<!-- end -->", block, text, flags=re.DOTALL)


if __name__ == "__main__":
    for path, content in files().items():
        path.write_text(content)
