"""`pa_ros film`: an agent that executes six programs, or one goal over time, as a film."""

from __future__ import annotations

import argparse
from pathlib import Path

from pydantic import Field

from pa_ros.cli.options import add_setting, file_to_write
from pa_ros.core.settings import Settings


class FilmOptions(Settings):
    """Content and size of a film."""

    seed: int = Field(0, ge=0, description="of scenes")
    width: int = Field(640, ge=64, le=2000, description="px")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros film`."""
    parser.add_argument(
        "--checkpoint", type=Path, default=Path("shipped:3-D"), help="of an agent (%(default)s)"
    )
    parser.add_argument(
        "--out", type=file_to_write, required=True, metavar="FILE.webp|FILE.gif|FILE.mp4"
    )
    add_setting(parser, FilmOptions, "seed")
    parser.add_argument(
        "--condition",
        default="",
        help="show the goal of its first episode, instead of six programs",
    )
    parser.add_argument("--program", default="", help="show this program, or goal over time")
    add_look(parser)


def add_look(parser: argparse.ArgumentParser) -> None:
    """Declare the options of how films look."""
    parser.add_argument(
        "--rendered", action=argparse.BooleanOptionalAction,
        help="in perspective, or from above (default: in perspective if there is OpenGL)",
    )  # fmt: skip
    add_setting(parser, FilmOptions, "width", metavar="PIXELS")


def run(options: argparse.Namespace) -> int:
    """Execute, draw, and say how many pictures there are."""
    from pa_ros.agents import load_agent
    from pa_ros.tools.film import film_execution

    agent = load_agent(options.checkpoint)
    count, missed = film_execution(
        agent, options.out, options.seed, options.width, options.rendered, options.condition,
        options.program,
    )  # fmt: skip
    print(f"{count} pictures in {options.out}; not reached: {', '.join(missed) or 'none'}")
    return 0
