"""Node processes: tied to their launcher's life, and told their parameters."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Mapping
from pathlib import Path

PARENT = "PA_ROS_PARENT"  # process id of the launcher; set for the children it must take along
_PR_SET_PDEATHSIG = 1


def die_with_parent() -> None:
    """In a child that a launcher started: be killed when the launcher's main thread ends.

    SIGKILL, because a SIGTERM can hang in rclpy; what matters on disk is written atomically.
    """
    parent = os.environ.pop(PARENT, None)
    if parent is None or not sys.platform.startswith("linux"):
        return
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != int(parent):  # it died before the call above
        raise SystemExit(1)


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


def _yaml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_yaml(item) for item in value) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value)
