"""Every command of README and docs, run as it stands, page by page: `make docs-check`.

What serves (a launch, a node, a page) runs beside the commands after it in its block. What hasn't
ended after LIMIT_S, or RECORDING_S, is interrupted, as with Ctrl-C, and must then end as
it should; but what makes something that the page goes on with runs to its end.
"""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest

from helpers.documents import ALL_NODES, COMMANDS, NODES, ROOT, Command, is_run
from helpers.waiting import DEADLINE_S

LIMIT_S = 20.0
RECORDING_S = 45.0  # what is recorded is looked at: an episode or two, on a busy machine, too
SERVING = re.compile(rf"pa_ros (launch|console|record)\b|python docs/|({'|'.join(ALL_NODES)})\b")
WITH_GRAPH = re.compile(r"pa_ros (send|play)\b")  # commands that need what serves
ENDED = (0, 130, -signal.SIGINT)  # done, or interrupted
# What a reader brings along: a file or run of his own, or a graph that runs already.
BROUGHT = {
    "docs/tools.md": "pa_ros train --frames 500 --out runs/mine --record runs/my-bag",
    "docs/robot.md": "cp docs/examples/robot.yaml .",
}
GRAPH_RUNS = {("docs/starting.md", 1): "pa_ros launch"}  # by block
# Shown for what they complain of.
REFUSED = {c.words[-1] for c in COMMANDS if c.output.startswith("pa_ros program: column")}


@dataclass
class Started:
    """A command that runs; `log` has what it says."""

    text: str
    folder: Path

    def __post_init__(self) -> None:
        count = sum(1 for _ in self.folder.glob("*.log"))
        self.log = self.folder / f"{count}.log"
        with self.log.open("w") as output:
            self.process = subprocess.Popen(
                ["bash", "-c", self.text], cwd=self.folder, stdin=subprocess.DEVNULL,
                stdout=output, stderr=subprocess.STDOUT, start_new_session=True,
            )  # fmt: skip

    def interrupt(self, after_s: float = 0.0) -> None:
        """Ctrl-C, unless it ends by itself within that time."""
        for number in (signal.SIGINT, signal.SIGKILL):
            try:
                self.process.wait(timeout=after_s)
                return
            except subprocess.TimeoutExpired:
                os.killpg(self.process.pid, number)
                after_s = DEADLINE_S
        self.process.wait()

    def complaint(self) -> str:
        """What is wrong with how it ended; empty if nothing is."""
        said, status = self.log.read_text(), self.process.returncode
        refused = shlex.split(self.text, comments=True)[-1] in REFUSED
        if status in ((2,) if refused else ENDED) and "Traceback" not in said:
            return ""
        return f"{self.text}\nexit status {status}\n{said}"


class Page:
    """Runs a page's commands in a folder where they find what is in the repository's."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._serving: list[Started] = []
        self.complaints: list[str] = []
        for name in ("docs", "tests", *NODES):
            (folder / name).symlink_to(ROOT / name)

    def run(self, text: str, limit_s: float = LIMIT_S) -> None:
        """To its end, or until it is interrupted."""
        if not WITH_GRAPH.match(text):
            self.stop(LIMIT_S)
        self._end(Started(text, self._folder), limit_s)

    def serve(self, text: str) -> None:
        """Beside what serves already, but for the same command with other options."""
        of = text.split()[:2]
        for other in [s for s in self._serving if s.text.split()[:2] == of and of[0] == "pa_ros"]:
            self._serving.remove(other)
            self._end(other, LIMIT_S)
        print(f"   serves    {text}", flush=True)
        self._serving.append(Started(text, self._folder))

    def stop(self, after_s: float = 0.0) -> None:
        """All that serves, the last first; not sooner than some seconds from here."""
        while self._serving:
            self._end(self._serving.pop(), after_s)
            after_s = 0.0

    def _end(self, started: Started, after_s: float) -> None:
        began = time.monotonic()
        if after_s and "--record" in started.text:
            after_s = max(after_s, RECORDING_S)
        started.interrupt(after_s)
        print(f"  {time.monotonic() - began:6.1f} s  {started.text}", flush=True)
        if complaint := started.complaint():
            self.complaints.append(complaint)
            print(complaint, flush=True)


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PATH", os.pathsep.join((f"{sys.prefix}/bin", os.environ["PATH"])))
    made = Page(tmp_path)
    yield made
    made.stop()


@pytest.mark.graph
@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", sorted({c.page for c in COMMANDS if is_run(c)}))
def test_a_pages_commands_do_what_they_are_shown_for(name: str, page: Page):
    print(f"\n{name}", flush=True)
    if name in BROUGHT:
        page.run(BROUGHT[name], DEADLINE_S * 5)
    given = [command for command in COMMANDS if command.page == name and is_run(command)]
    for i, command in enumerate(given):
        if (name, command.block) in GRAPH_RUNS:
            page.serve(GRAPH_RUNS[name, command.block])
        if SERVING.match(command.text):
            page.serve(command.text)
        else:
            page.run(command.text, limit_s(command, given[i + 1 :]))
        if command.block not in {later.block for later in given[i + 1 :]}:
            page.stop(LIMIT_S if SERVING.match(command.text) else 0.0)
    assert not page.complaints, "\n\n".join(page.complaints)


def limit_s(command: Command, later: list[Command]) -> float:
    """How long a command may take."""
    made = dict(pairwise(command.words)).get("--out", "")
    return DEADLINE_S * 5 if any(made and made in other.words for other in later) else LIMIT_S
