"""Start, watch and stop child processes together. Needs no ROS."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pa_ros.core.errors import PaError
from pa_ros.core.signals import interrupts_later
from pa_ros.ros.environment import ros_arguments
from pa_ros.ros.node_main import PARENT

TAIL_LINES = 15
POLL_S = 0.02


@dataclass(frozen=True)
class Patience:
    """Seconds to wait after each signal before the next, harder one."""

    interrupt_s: float = 10.0  # after SIGINT: a learner may be writing its checkpoint
    terminate_s: float = 3.0  # after SIGTERM: rclpy's handler can leave a process hung
    kill_s: float = 5.0  # after SIGKILL: until the kernel has removed the process


class ChildError(PaError):
    """A child ended by itself, or can't be ended; the text has its log's last lines."""

    code = "launch.child"


@dataclass
class _Child:
    name: str
    process: subprocess.Popen[bytes]
    log: Path


class Supervisor:
    """Starts children, notices when one ends, and stops them all; a context manager.

    Each child has its own session and process group, so that Ctrl-C in the terminal reaches only
    this process, which then stops the children in order. A child also ends by itself when this
    process has ended (`pa_ros.ros.node_main.die_with_parent`). Its stdout and stderr go to
    `<name>.log`.
    """

    def __init__(
        self,
        log_folder: Path,
        environment: Mapping[str, str] | None = None,
        patience: Patience | None = None,
    ) -> None:
        """`environment` replaces variables of this process's environment."""
        self._log_folder = log_folder
        self._environment = {**os.environ, **(environment or {}), PARENT: str(os.getpid())}
        # A child must not import a random.py of the user's from the current folder.
        self._environment["PYTHONSAFEPATH"] = "1"
        self._patience = patience or Patience()
        self._children: list[_Child] = []

    def __enter__(self) -> Supervisor:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def names(self) -> list[str]:
        """Names of the children that were started and not stopped yet."""
        return [child.name for child in self._children]

    def start(self, name: str, command: Sequence[str]) -> int:
        """Start a child; its process id."""
        self._log_folder.mkdir(parents=True, exist_ok=True)
        log = self._log_folder / f"{name}.log"
        # An interrupt between the fork and the list would leave a child that nobody stops.
        with log.open("ab") as output, interrupts_later():
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=self._environment,
                start_new_session=True,
            )
            self._children.append(_Child(name, process, log))
        return process.pid

    def check(self) -> None:
        """Raise ChildError if a child has ended by itself. Each child is reported once."""
        for child in self._children:
            status = child.process.poll()
            if status is not None:
                self._children.remove(child)
                raise ChildError(
                    f"{child.name} ended by itself ({status_text(status)}); the last lines of "
                    f"{child.log}:\n{tail(child.log)}"
                )

    def stop(self, only: Sequence[str] | None = None) -> dict[str, int]:
        """Stop some or all children: SIGINT, then SIGTERM, then SIGKILL.

        Returns each exit status, negative for the signal that ended the child. A second Ctrl-C
        meanwhile skips to SIGKILL. Raises ChildError if even that doesn't end a child.
        """
        chosen = [child for child in self._children if only is None or child.name in only]
        patience = self._patience
        try:
            # Each signal is harder than the one before: SIGINT lets a learner write its checkpoint.
            self._signal(chosen, signal.SIGINT, patience.interrupt_s)
            self._signal(chosen, signal.SIGTERM, patience.terminate_s)
        finally:
            self._signal(chosen, signal.SIGKILL, patience.kill_s)
            self._children = [child for child in self._children if child not in chosen]
        statuses = {child.name: child.process.poll() for child in chosen}
        stuck = [name for name, status in statuses.items() if status is None]
        if stuck:
            raise ChildError(f"{', '.join(stuck)}: still running {patience.kill_s} s after SIGKILL")
        return {name: status for name, status in statuses.items() if status is not None}

    def _signal(self, children: Sequence[_Child], number: signal.Signals, wait_s: float) -> None:
        """Signal the running ones of some children, and wait until they end, at most `wait_s`."""
        running = [child for child in children if child.process.poll() is None]
        for child in running:
            try:
                os.killpg(child.process.pid, number)
            except ProcessLookupError:
                continue
        deadline = time.monotonic() + wait_s
        while running and time.monotonic() < deadline:
            time.sleep(POLL_S)
            running = [child for child in running if child.process.poll() is None]


def node_command(nodes: Sequence[str], params: Path, namespace: str = "") -> list[str]:
    """The command that runs nodes in one process, with a parameters file."""
    within = f"/{namespace.strip('/')}" if namespace.strip("/") else None
    arguments = ros_arguments(params_file=params.resolve(), namespace=within)
    alone = len(nodes) == 1
    module = [f"{nodes[0]}.main"] if alone else ["pa_ros.ros.composition", *nodes]
    return [sys.executable, "-m", *module, *arguments]


def tail(log: Path) -> str:
    """The last lines of a log, of which at most 16 kB are read."""
    with log.open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - 16_384))
        text = file.read().decode(errors="replace")
    return "\n".join(text.splitlines()[-TAIL_LINES:]) or "(it wrote nothing)"


def status_text(status: int) -> str:
    """An exit status in words; negative for the signal that ended the process."""
    return f"exit status {status}" if status >= 0 else f"killed by {signal.Signals(-status).name}"
