"""Entry point of the `pa_ros` command.

What takes time to import is imported in `main`, which ends in order when a signal comes.
"""

from __future__ import annotations

import argparse
import errno
import importlib
import io
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from pa_ros import __version__
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.signals import EXIT_INTERRUPTED, Interrupted, signals_interrupt
from pa_ros.core.software import check_opengl
from pa_ros.core.text import did_you_mean, printable_lines

# name: (module, one line of help). A module defines add_arguments(parser) and run(args) -> int.
COMMANDS = {
    "program": ("pa_ros.cli.program", "check the text of a program"),
    "train": ("pa_ros.cli.train", "train in one process, without ROS"),
    "experiment": ("pa_ros.cli.experiment", "several seeds of one setting, as a table"),
    "ship": ("pa_ros.cli.ship", "make a run's policy one of the package's own"),
    "figures": ("pa_ros.cli.figures", "draw the pictures of the experiments' tables"),
    "eval": ("pa_ros.cli.evaluate", "evaluate a checkpoint or a reference policy"),
    "film": ("pa_ros.cli.film", "an agent that executes six programs, as a film"),
    "launch": ("pa_ros.cli.launch", "start nodes and show one live table"),
    "send": ("pa_ros.cli.send", "send a program to a running graph"),
    "record": ("pa_ros.cli.record", "record a running graph into a rosbag2 bag"),
    "bag": ("pa_ros.cli.bag", "what a bag holds; its episodes as NPZ or as a film"),
    "play": ("pa_ros.cli.play", "publish a bag into a live graph"),
    "verify": ("pa_ros.cli.verify", "make a recorded run again and compare it to the last bit"),
    "console": ("pa_ros.cli.console", "a page in the browser: a running graph, or a bag"),
    "demo": ("pa_ros.cli.demo", "learn over the graph, then execute programs (make run)"),
}
ABOUT = "Programmable agents: arms that execute declarative programs."
EXIT_UNSAID = 1  # the work was done, but not all that was to be said of it could be written
EXIT_REFUSED = 2  # the user's input was refused, as argparse does
EXIT_PIPE = 141  # as a shell says of SIGPIPE
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # what standard output goes to


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, and suggest an option for a misspelled one."""

    def error(self, message: str) -> NoReturn:
        raise ConfigError(f"{message} (see {self.prog} --help)")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:
            name = unknown[0].partition("=")[0]
            known = did_you_mean(name, self._option_string_actions, few=0)
            self.error(f"unknown argument {name}{known}")
        return options, unknown


def build_parser(chosen: str | None) -> argparse.ArgumentParser:
    """The parser; only the chosen command's module is imported, since torch and rclpy are slow."""
    from pa_ros.cli.options import add_extension

    parser = _Parser(prog="pa_ros", description=ABOUT, allow_abbrev=False)
    parser.add_argument("--version", action="version", version=f"pa_ros {__version__}")
    add_extension(parser)
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (module, summary) in COMMANDS.items():
        subparser = subparsers.add_parser(
            name, help=summary, description=summary, allow_abbrev=False
        )
        if name == chosen:
            importlib.import_module(module).add_arguments(subparser)
            add_extension(subparser)
    return parser


def load_extensions(arguments: Sequence[str]) -> list[str]:
    """Import them before the command's options are made, whose choices they add to; their names."""
    from pa_ros.cli.options import add_extension
    from pa_ros.core import extensions

    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    add_extension(parser)
    given: list[str] = parser.parse_known_args(arguments)[0].extension
    extensions.load(given)
    return given


def _run(arguments: Sequence[str], chosen: str | None) -> int:
    check_opengl()
    given = load_extensions(arguments)
    options = build_parser(chosen).parse_args(arguments)
    options.extension = given  # those before the command, too
    return int(importlib.import_module(COMMANDS[options.command][0]).run(options))


def main(argv: Sequence[str] | None = None) -> int:
    """Run one subcommand; returns its exit status (2: the input was refused)."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    chosen = next((a for a in arguments if a in COMMANDS), None)
    command = f"pa_ros {chosen}" if chosen else "pa_ros"
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # as standard error: text has … and —
    try:
        with signals_interrupt():
            status = _run(arguments, chosen)
        if sys.stdout is not None:  # closed by who started it
            sys.stdout.flush()
        return status
    except PaError as error:
        print(f"{command}: {printable_lines(str(error))}", file=sys.stderr)
        return EXIT_REFUSED
    except Interrupted as interrupted:
        return interrupted.status
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # `| head` has read enough; nothing is left to be flushed at the end
        _say_no_more()
        return EXIT_PIPE
    except OSError as error:
        if error.filename is not None:  # a path that the system refuses
            print(f"{command}: {printable_lines(str(error))}", file=sys.stderr)
            return EXIT_REFUSED
        if error.errno not in FULL:
            raise
        _say_no_more()
        print(f"{command}: standard output: {error}", file=sys.stderr)
        return EXIT_UNSAID


def _say_no_more() -> None:
    """What standard output has yet to write goes nowhere, also at the interpreter's end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
