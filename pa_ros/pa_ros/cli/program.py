"""`pa_ros program check TEXT`: the canonical form, or the error with exit status 2."""

from __future__ import annotations

import argparse
import sys

from pa_ros.language.parser import parse
from pa_ros.language.syntax import NEAR
from pa_ros.language.vocabulary import Vocabulary
from pa_ros.world.relation import RELATIONS
from pa_ros.world.schema import PAPER


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros program`."""
    parser.add_argument("action", choices=["check"])
    parser.add_argument("text", help="a program, or - to read it from standard input")
    every = "use the vocabulary of this design (default: every word and relation)"
    parser.add_argument("--design", help=every)


def vocabulary(design: str | None) -> Vocabulary:
    """The vocabulary of a design, or the arena's own words and all relations."""
    if design is None:
        return PAPER.vocabulary.asking(*sorted(RELATIONS, key=lambda name: name != NEAR))
    from pa_ros.arena.designs import design_named

    return design_named(design).vocabulary


def run(options: argparse.Namespace) -> int:
    """Print the canonical form; a refused program raises ProgramError."""
    text = sys.stdin.read() if options.text == "-" else options.text
    print(parse(text, vocabulary(options.design)))
    return 0
