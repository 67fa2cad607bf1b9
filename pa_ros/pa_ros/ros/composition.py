"""Several nodes in one process: `python -m pa_ros.ros.composition NODE NODE --ros-args …`.

They share one executor, so one thread. Two threads would wait for each other at Python's
interpreter lock: measured, that is slower than one. Messages between the nodes don't leave the
process, which saves the operating system two wake-ups per control step. Topics, services,
parameters, lifecycle and diagnostics are those of separate processes.
"""

from __future__ import annotations

import sys
from importlib import import_module
from itertools import takewhile

from pa_ros.ros.node_main import run_node


def main() -> int:
    """Run the nodes named before `--ros-args` until SIGINT or SIGTERM; the exit status."""
    names = list(takewhile(lambda word: not word.startswith("-"), sys.argv[1:]))
    makes = [import_module(f"{name}.main").NODE for name in names]
    return run_node("+".join(names), *makes, arguments=sys.argv[1 + len(names) :])


if __name__ == "__main__":
    sys.exit(main())
