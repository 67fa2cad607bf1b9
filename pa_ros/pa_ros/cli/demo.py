"""`pa_ros demo` (`make run`): a shipped agent executes programs; then one learns from scratch."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from pa_ros.arena import ArenaChoice, design_named, preset_named
from pa_ros.cli.options import add_setting, add_settings, settings_from
from pa_ros.core.errors import PaError
from pa_ros.tools.demo.config import DemoConfig
from pa_ros.tools.demo.phases import demonstrate
from pa_ros.tools.domain import use_domain
from pa_ros.tools.graph import signals_noted

EXIT_FAILED, EXIT_INTERRUPTED = 1, 130


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
    add_setting(parser, DemoConfig, "folder", "--out", "runs/demo-<time>", "DIR")
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
    with signals_noted() as interrupted:
        try:
            return 0 if demonstrate(config, options.shipped, interrupted) else EXIT_FAILED
        except KeyboardInterrupt:
            print("interrupted; every process was stopped")
            return EXIT_INTERRUPTED
        except PaError as error:
            print(f"pa_ros demo: {error}", file=sys.stderr)
            return EXIT_FAILED
