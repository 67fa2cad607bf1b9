"""`pa_ros console`: a page that shows a running graph, or a recorded one."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from pa_ros.cli.options import add_settings, settings_from
from pa_ros.console.settings import ConsoleSettings
from pa_ros.core.errors import needs_extra
from pa_ros.core.signals import signals_noted
from pa_ros.ros.environment import check_namespace
from pa_ros.ros.node_main import die_with_parent

if TYPE_CHECKING:
    from pa_ros.tools.client import Node

NICE = 5  # arena, agents and learner come first


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros console`."""
    add_settings(parser, ConsoleSettings, "port", "light")
    parser.add_argument(
        "--namespace", default="", help="namespace of the arena that is shown first"
    )
    parser.add_argument("--bag", type=Path, metavar="BAG", help="show a recording instead")
    parser.epilog = "Ctrl-C stops it. Pages without the token are for viewing only."


def run(options: argparse.Namespace) -> int:
    """Serve the page until a signal comes."""
    die_with_parent()
    _check_installed()
    from pa_ros.console.serve import serve_bag, serve_graph

    settings = settings_from(options, ConsoleSettings)
    check_namespace(options.namespace)
    os.nice(NICE)
    with signals_noted() as interrupted:
        if options.bag is not None:
            serve_bag(options.bag, settings, options.namespace or None, interrupted, _announce)
        else:
            serve_graph(settings, options.namespace, interrupted, _announce)
    return 0


@contextmanager
def page_beside(node: Node, options: argparse.Namespace) -> Iterator[None]:
    """Serve a page on a free port while the node runs, if the option `console` is given."""
    if not options.console:
        yield
        return
    _check_installed()
    from pa_ros.console.serve import beside

    with beside(node, ConsoleSettings(port=0), options.namespace) as server:
        _announce(*server.addresses)
        yield


def _announce(control_address: str, view_address: str) -> None:
    print(f"console: {control_address}\n  (for viewing only: {view_address})", flush=True)


def _check_installed() -> None:
    """Raise ConfigError without the extra `console`."""
    with needs_extra("console", "console"):
        import mjviser  # noqa: F401
        import viser  # noqa: F401
