"""`pa_ros demo` (`make run`): a shipped agent executes programs; then one learns from scratch."""

from __future__ import annotations

import argparse
import secrets
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from pa_ros.arena import ArenaChoice, design_named, preset_named
from pa_ros.cli.options import add_settings, folder_to_write, settings_from
from pa_ros.console.address import TOKEN, free_port, sending
from pa_ros.core.errors import PaError
from pa_ros.core.signals import EXIT_INTERRUPTED, signals_noted
from pa_ros.tools.demo.config import DemoConfig
from pa_ros.tools.demo.phases import demonstrate
from pa_ros.tools.domain import use_domain
from pa_ros.tools.launcher import Supervisor

EXIT_FAILED = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros demo`."""
    add_settings(parser, ArenaChoice, "design", "arm", "preset")
    add_settings(parser, DemoConfig, "seed", "minutes")
    parser.add_argument(
        "--no-shipped",
        dest="shipped",
        action="store_false",
        help="begin with learning: leave out the shipped agent's programs",
    )
    parser.add_argument(
        "--no-console", dest="console", action="store_false",
        help="don't serve the page of `pa_ros console` meanwhile, which is done where its extra is",
    )  # fmt: skip
    parser.add_argument(
        "--out", dest="folder", type=folder_to_write, metavar="DIR",
        help=f"{DemoConfig.leaf('folder').description} (runs/demo-<time>)",
    )  # fmt: skip
    parser.add_argument(
        "--domain-id", type=int, metavar="N", help="ROS domain (default: an unused one)"
    )
    parser.epilog = (
        "exit status: 0 if the held-out program and at least five of the six were executed by "
        "each agent, 1 if not, 130 if interrupted"
    )


def run(options: argparse.Namespace) -> int:
    """Demonstrate; the exit status."""
    folder = options.folder or Path("runs") / f"demo-{time.strftime('%Y%m%d-%H%M%S')}"
    design, arena = design_named(options.design), preset_named(options.preset, options.arm)
    config = settings_from(options, DemoConfig, design=design, arena=arena, folder=folder)
    print(f"ROS domain {use_domain(options.domain_id)}; everything is left in {folder}/\n")
    with signals_noted() as interrupted, _page(options.console, folder):
        try:
            return 0 if demonstrate(config, options.shipped, interrupted) else EXIT_FAILED
        except KeyboardInterrupt:
            print("interrupted; every process was stopped")
            return EXIT_INTERRUPTED
        except PaError as error:
            print(f"pa_ros demo: {error}", file=sys.stderr)
            return EXIT_FAILED


@contextmanager
def _page(wanted: bool, folder: Path) -> Iterator[None]:
    """A console beside all phases, in a process that ends with this one; where it is installed."""
    if not wanted:
        yield
        return
    if any(find_spec(name) is None for name in ("viser", "mjviser")):
        print("no page to look at: `make install-console` brings what it needs\n")
        yield
        return
    port, token = free_port(), secrets.token_urlsafe(16)
    command = [sys.executable, "-m", "pa_ros", "console", "--port", f"{port}"]
    with Supervisor(folder / "log", {TOKEN: token}) as supervisor:
        supervisor.start("console", command)
        print(f"the page to look at, in a moment: {sending(port, token)}\n", flush=True)
        yield
