"""Nodes and programs as processes of their own."""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from helpers.waiting import DEADLINE_S


def node_command(name: str, *arguments: str) -> list[str]:
    """The command line of one of our nodes in this interpreter."""
    return [sys.executable, "-m", f"{name}.main", *arguments]


def pa_ros(*arguments: str | Path) -> subprocess.Popen[str]:
    """Start a `pa_ros` command as a separate process."""
    return subprocess.Popen(
        [sys.executable, "-m", "pa_ros", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@contextmanager
def running(
    folder: Path, *commands: Sequence[str], cwd: Path | None = None
) -> Iterator[list[Path]]:
    """Start commands and terminate them at the end, each with status 0; yields their logs."""
    logs = [folder / f"{number}.log" for number in range(len(commands))]
    started = []
    try:
        for command, log in zip(commands, logs, strict=True):
            with log.open("w") as output:
                started.append(subprocess.Popen(command, cwd=cwd, stderr=output))
        yield logs
    finally:
        for process in started:
            process.terminate()
        ended = [process.wait(DEADLINE_S) for process in started]
    assert not any(ended), [(status, log.read_text()) for status, log in zip(ended, logs)]  # noqa: B905


def processes_of(folder: Path, option: str = "") -> list[int]:
    """Running processes whose command names a path under a folder, and has an option."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            command = entry.read_bytes()
            if f"{folder}/".encode() in command and option.encode() in command:
                found.append(int(entry.parent.name))
        except OSError:
            continue
    return found
