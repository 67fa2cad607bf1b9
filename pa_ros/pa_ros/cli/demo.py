"""`pa_ros demo` (`make run`): a shipped agent executes programs; then one learns from scratch."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from pa_ros.arena import design_named, preset_named
from pa_ros.core.errors import PaError
from pa_ros.tools.demo.config import DemoConfig
from pa_ros.tools.demo.phases import demonstrate
from pa_ros.tools.domain import use_domain
from pa_ros.tools.graph import signals_noted

EXIT_FAILED, EXIT_INTERRUPTED = 1, 130


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros demo`."""
    parser.add_argument("--design", default="2-L", help="2-L or 3-D (%(default)s)")
    parser.add_argument("--preset", default="fast", help="arena: fast or paper (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="(%(default)s)")
    parser.add_argument(
        "--minutes", type=float, default=20.0, help="give up learning after these (%(default)s)"
    )
    parser.add_argument(
        "--no-shipped",
        dest="shipped",
        action="store_false",
        help="begin with learning: leave out the shipped agent's programs",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="(default: runs/demo-<time>)")
    parser.add_argument(
        "--domain-id", type=int, metavar="N", help="ROS domain (default: an unused one)"
    )
    parser.epilog = (
        "exit status: 0 if the held-out program and at least five of the six were executed by "
        "each agent, 1 if not, 130 if interrupted"
    )


def run(options: argparse.Namespace) -> int:
    """Demonstrate; the exit status."""
    folder = options.out or Path("runs") / f"demo-{time.strftime('%Y%m%d-%H%M%S')}"
    design, arena = design_named(options.design), preset_named(options.preset)
    config = DemoConfig(
        design=design, arena=arena, seed=options.seed, minutes=options.minutes, folder=folder
    )
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
