"""`pa_ros program check TEXT`: the canonical form, or the error with exit status 2.

`pa_ros program from-ltl TEXT` prints that of the goal of a formula."""

from __future__ import annotations

import argparse
import sys

from pa_ros.arena.config import ArenaChoice
from pa_ros.cli.options import add_setting, add_settings, settings_from
from pa_ros.language.ltl import goal_from_ltl
from pa_ros.language.parser import parse_goal

DESIGN = "3-D"  # of the agent that `pa_ros launch` starts


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros program`."""
    parser.add_argument("action", choices=["check", "from-ltl"])
    parser.add_argument("text", help="a program or formula, or - to read it from standard input")
    add_setting(parser, ArenaChoice, "design", otherwise=f"{DESIGN}, as `pa_ros launch`")
    add_settings(parser, ArenaChoice, "relations")


def run(options: argparse.Namespace) -> int:
    """Print the canonical form; a refused program raises ProgramError."""
    text = sys.stdin.read() if options.text == "-" else options.text
    options.design = options.design or DESIGN
    read = parse_goal if options.action == "check" else goal_from_ltl
    print(read(text, settings_from(options, ArenaChoice).design_of().vocabulary))
    return 0
