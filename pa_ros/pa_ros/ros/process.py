"""Node processes: started with their parent's fate, stopped cleanly or else killed."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

PARENT = "PA_ROS_PARENT"  # process id of the launcher; set for the children it must take along
_PR_SET_PDEATHSIG = 1


def die_with_parent() -> None:
    """In a child that `start_node` started: be killed when the launcher's main thread ends.

    SIGKILL, because a SIGTERM can hang in rclpy; what matters on disk is written atomically.
    """
    parent = os.environ.pop(PARENT, None)
    if parent is None or not sys.platform.startswith("linux"):
        return
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != int(parent):  # it died before the call above
        raise SystemExit(1)


def start_node(
    name: str,
    arguments: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    log: Path | None = None,
) -> subprocess.Popen[bytes]:
    """Start `sim_node`, `agent_node` or `learner_node` as a process of its own.

    `arguments` as for any ROS node (see `ros_arguments`). Call from the main thread: the child
    dies with the thread that started it. Output goes to `log`, or where ours goes.
    """
    variables = {**os.environ, **(environment or {}), PARENT: str(os.getpid())}
    with log.open("ab") if log else contextlib.nullcontext() as output:
        return subprocess.Popen(
            [sys.executable, "-m", f"{name}.main", *arguments],
            env=variables,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT if output else None,
        )


def ros_arguments(
    parameters: Mapping[str, object] | None = None,
    params_file: Path | str | None = None,
    namespace: str | None = None,
    name: str | None = None,
    remaps: Mapping[str, str] | None = None,
) -> list[str]:
    """Command-line arguments that give a node its parameters, namespace, name and remaps."""
    arguments = ["--ros-args"]
    if params_file is not None:
        arguments += ["--params-file", str(params_file)]
    for key, value in (parameters or {}).items():
        arguments += ["-p", f"{key}:={_yaml(value)}"]
    rules = {"__ns": namespace, "__node": name, **(remaps or {})}
    for source, target in rules.items():
        if target is not None:
            arguments += ["-r", f"{source}:={target}"]
    return arguments


def stop_processes(processes: Iterable[subprocess.Popen[bytes]], grace_s: float = 10.0) -> None:
    """Interrupt them all, wait together, kill what is left; returns when none runs."""
    running = [process for process in processes if process.poll() is None]
    for process in running:
        process.send_signal(signal.SIGINT)
    deadline = time.monotonic() + grace_s
    for process in running:
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _yaml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_yaml(item) for item in value) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value)
