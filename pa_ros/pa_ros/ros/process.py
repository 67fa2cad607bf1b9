"""Node processes: tied to their launcher's life, and told their parameters."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Mapping
from pathlib import Path

PARENT = "PA_ROS_PARENT"  # process id of the launcher; set for the children it must take along
PARENT_S = 0.25  # between two looks whether it is there


def die_with_parent(grace_s: float = 10.0, lingers_s: float = 0.0) -> None:
    """In a child that a launcher started: stop, as at SIGTERM, when the launcher has ended.

    So a learner writes its checkpoint, and a recorder closes its bag; `lingers_s` later, for who is
    to hear the others' last words. Who has not ended `grace_s` after that is killed.
    """
    given = os.environ.pop(PARENT, None)
    if given is None:
        return
    parent = int(given)
    if os.getppid() != parent:
        raise SystemExit(1)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_S)
        time.sleep(lingers_s)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(grace_s)
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=watch, name="parent", daemon=True).start()


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
