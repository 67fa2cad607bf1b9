"""`pa_ros mcp`: a server for assistants, by the Model Context Protocol over stdin and stdout."""

from __future__ import annotations

import argparse
from functools import partial

from pa_ros.core.errors import needs_extra


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros mcp`."""
    parser.add_argument("--namespace", default="", help="of the arena")
    parser.add_argument(
        "--allow-execute", action="store_true",
        help="also offer `execute` and `cancel`: assistants may move the arm",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Serve until standard input is closed."""
    with needs_extra("mcp", "mcp"):
        from pa_ros.tools.assistants import Table, make_server
    from pa_ros.tools.arm import Arm

    table = Table(partial(Arm, options.namespace))
    try:
        make_server(table, options.allow_execute).run("stdio")
    finally:
        table.close()
    return 0
