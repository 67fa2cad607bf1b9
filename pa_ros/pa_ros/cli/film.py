"""`pa_ros film`: an agent that executes six programs, as a film."""

from __future__ import annotations

import argparse
from pathlib import Path

from pa_ros.cli.options import file_to_write
from pa_ros.core.errors import ConfigError

SMALLEST_PX, LARGEST_PX = 64, 2000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros film`."""
    parser.add_argument(
        "--checkpoint", type=Path, default=Path("shipped:3-D"), help="of an agent (%(default)s)"
    )
    parser.add_argument(
        "--out", type=file_to_write, required=True, metavar="FILE.webp|FILE.gif|FILE.mp4"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of scenes (%(default)s)")
    add_look(parser)


def add_look(parser: argparse.ArgumentParser) -> None:
    """Declare the options of how films look."""
    parser.add_argument("--rendered", action="store_true", help="in perspective; needs OpenGL")
    parser.add_argument("--width", type=int, default=640, metavar="PIXELS", help="(%(default)s)")


def check_look(options: argparse.Namespace) -> None:
    """ConfigError for a size that no film has."""
    if not SMALLEST_PX <= options.width <= LARGEST_PX:
        raise ConfigError(
            f"--width: expected {SMALLEST_PX} to {LARGEST_PX} pixels, got {options.width}"
        )


def run(options: argparse.Namespace) -> int:
    """Execute, draw, and say how many pictures there are."""
    check_look(options)
    if options.seed < 0:
        raise ConfigError(f"--seed: expected an integer of at least 0, got {options.seed}")
    from pa_ros.evaluation.agents import load_agent
    from pa_ros.tools.film import film_execution

    agent = load_agent(options.checkpoint)
    count, missed = film_execution(
        agent, options.out, options.seed, options.width, options.rendered
    )
    print(f"{count} pictures in {options.out}; not reached: {', '.join(missed) or 'none'}")
    return 0
