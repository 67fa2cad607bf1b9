"""Commands in the fenced blocks of README and docs, as they stand there."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / name for name in ("README.md", "RESULTS.md", "FAULTS.md")] + sorted(
    ROOT.glob("docs/*.md")
)
NODES = ("sim_node", "agent_node", "learner_node")
PROGRAMS = ("pa_ros", *NODES, "make", "ros2", "colcon", "python", "source", "export", "pip", "(")
SHELLS = ("", "sh", "bash", "console")
STUDIES = ("generalization", "equalities", "detectors", "variants", "algorithms")
FENCED = re.compile(r"^( *)```(.*)\n((?:.*\n)*?)\1```", re.MULTILINE)


@dataclass(frozen=True)
class Command:
    """One command of a page; `block` counts the page's fenced blocks that hold commands."""

    page: str
    block: int
    text: str
    output: str = ""  # what a block shows of it, where its commands stand behind `$ `

    @cached_property
    def words(self) -> list[str]:
        """As a shell takes it apart, comments left out."""
        return shlex.split(self.text, comments=True)

    @property
    def program(self) -> str:
        return self.words[0]

    def __str__(self) -> str:
        return f"{self.page}: {' '.join(self.text.split())}"


def session(page: str, block: int, text: str) -> list[Command]:
    """Commands behind `$ `, each with the lines that follow it."""
    parts = re.split(r"^\$ (.*)\n", text, flags=re.MULTILINE)[1:]
    return [Command(page, block, *pair) for pair in zip(parts[::2], parts[1::2], strict=True)]


def documented(page: Path) -> list[Command]:
    """Of every fenced block of a shell's language, or none, whose lines are commands."""
    found: list[Command] = []
    for block, (_, language, text) in enumerate(FENCED.findall(page.read_text())):
        name = page.relative_to(ROOT).as_posix()
        if text.startswith("$ "):
            found += session(name, block, text)
            continue
        lines = [line.strip() for line in text.replace("\\\n", " ").splitlines()]
        lines = [line for line in lines if line and not line.startswith("#")]
        if language in SHELLS and all(line.startswith(PROGRAMS) for line in lines):
            if not lines[0].partition(" ")[2].lstrip().startswith("="):  # a grammar's rule
                found += [Command(name, block, line) for line in lines]
    return found


COMMANDS = [command for page in PAGES for command in documented(page)]

# How commands begin that `make docs-check` does not run, and why; test_documented_commands.py looks
# at what they name and takes their options. All others it runs as they stand.
NOT_RUN = {
    "make": "it is the installation, and what CI runs",
    "source": "of the person's shell",
    "export": "of the person's shell",
    "ros2": "not on the Python index",
    **dict.fromkeys(
        (f"pa_ros experiment {name}" for name in STUDIES),
        "needs ten trained agents, or other tables: hours",
    ),
}


def is_run(command: Command) -> bool:
    return not any(f"{command.text} ".startswith(f"{start} ") for start in NOT_RUN)
