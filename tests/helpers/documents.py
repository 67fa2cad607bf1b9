"""The commands that the fenced blocks of README and docs show."""

import re
import shlex
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / name for name in ("README.md", "RESULTS.md", "FAULTS.md")] + sorted(
    ROOT.glob("docs/*.md")
)
NODES = ("sim_node", "agent_node", "learner_node")  # each with a package of its name
ALL_NODES = (*NODES, "robot_node")
OTHERS = ("make", "ros2", "colcon", "python", "source", "export", "pip", "ray", "(umask")
PROGRAMS = tuple(f"{name} " for name in ("pa_ros", *ALL_NODES, *OTHERS))
SHELLS = ("sh", "bash", "console")
STUDIES = ("generalization", "equalities", "detectors", "variants")
FENCED = re.compile(r"^( *)```(.*)\n((?:.*\n)*?)\1```", re.MULTILINE)


@dataclass(frozen=True)
class Command:
    """One command of a page; `block` counts the page's fenced blocks that hold commands."""

    page: str
    block: int
    text: str
    output: str = ""  # what the block shows as its output, where commands begin with `$ `

    @cached_property
    def words(self) -> list[str]:
        """The words of the command as a shell splits them, without comments."""
        return shlex.split(self.text, comments=True)

    @property
    def program(self) -> str:
        return self.words[0]

    def __str__(self) -> str:
        return f"{self.page}: {' '.join(self.text.split())}"


def session(page: str, block: int, text: str) -> list[Command]:
    """The commands after `$ `, each with the output lines that follow it."""
    parts = re.split(r"^\$ (.*)\n", text, flags=re.MULTILINE)[1:]
    return [Command(page, block, *pair) for pair in zip(parts[::2], parts[1::2], strict=True)]


def documented(page: Path) -> list[Command]:
    """The commands of a page. A fenced block is shell by its language or, without one, by its
    lines."""
    found: list[Command] = []
    for block, (_, language, text) in enumerate(FENCED.findall(page.read_text())):
        name = page.relative_to(ROOT).as_posix()
        lines = [line.strip() for line in text.replace("\\\n", " ").splitlines()]
        of_shell = not language and any(line.startswith(PROGRAMS) for line in lines)
        if text.startswith("$ "):
            found += session(name, block, text)
        elif language in SHELLS or of_shell:
            found += [Command(name, block, x) for x in lines if x and not x.startswith("#")]
    return found


COMMANDS = [command for page in PAGES for command in documented(page)]

# How the commands begin that `make docs-check` does not run, and why. test_documented_commands.py
# still checks their options and the files they name. All other commands are run unchanged.
NOT_RUN = {
    "make": "the installation, which CI runs",
    "source": "sets up the user's shell",
    "export": "sets up the user's shell",
    "ros2": "not on the Python index",
    "ray": "needs several machines; tests/lab/test_cluster.py starts it on two",
    "pa_ros experiment programmable-3D --seeds 10 --cluster": "needs a cluster",
    **dict.fromkeys(
        (f"pa_ros experiment {name}" for name in STUDIES),
        "needs ten trained agents, or other tables: hours",
    ),
}


def is_run(command: Command) -> bool:
    return not any(f"{command.text} ".startswith(f"{start} ") for start in NOT_RUN)
