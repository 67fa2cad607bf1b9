"""The source files of the packages."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "pa_ros": ROOT / "pa_ros/pa_ros",
    "sim_node": ROOT / "sim_node/sim_node",
    "agent_node": ROOT / "agent_node/agent_node",
    "learner_node": ROOT / "learner_node/learner_node",
}


def files() -> list[tuple[str, Path]]:
    """(module, path) of every source file."""
    found = []
    for package, folder in PACKAGES.items():
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            found.append((".".join([package, *(p for p in parts if p != "__init__")]), path))
    return found
