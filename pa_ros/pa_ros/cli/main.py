"""Entry point of the `pa_ros` command.

Slow imports happen inside `main`, which ends in order when a signal arrives.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from pa_ros.cli.laboratory import import_command
from pa_ros.core import __version__
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.signals import EXIT_INTERRUPTED, Interrupted, signals_interrupt
from pa_ros.core.software import check_opengl
from pa_ros.core.streams import open_standard_streams
from pa_ros.core.text import did_you_mean, printable_lines
from pa_ros.ros.environment import require_ros

# name: (module, one line of help). A module defines add_arguments(parser) and run(args) -> int.
COMMANDS = {
    "program": ("pa_ros.cli.program", "check the text of a program"),
    "train": ("pa_ros.cli.train", "train in one process, without ROS"),
    "experiment": (
        "laboratory.commands.experiment",
        "train several seeds of one setting, or study them",
    ),
    "ship": ("laboratory.commands.ship", "add the policy of a run to the package"),
    "export": ("pa_ros.cli.export", "an agent as an ONNX file or a model card"),
    "figures": ("laboratory.commands.figures", "draw the tables of experiments"),
    "eval": ("pa_ros.cli.evaluate", "evaluate a checkpoint or a reference policy"),
    "film": ("pa_ros.cli.film", "an agent that executes six programs, as a film"),
    "launch": ("pa_ros.cli.launch", "start nodes and show one live table"),
    "send": ("pa_ros.cli.send", "send a program to a running graph"),
    "scatter": ("pa_ros.cli.scatter", "stop a robot that learns, to scatter its blocks"),
    "record": ("pa_ros.cli.record", "record a running graph into a rosbag2 bag"),
    "bag": ("pa_ros.cli.bag", "describe a bag; export its episodes as NPZ or as a film"),
    "play": ("pa_ros.cli.play", "publish a bag into a live graph"),
    "verify": ("pa_ros.cli.verify", "repeat a recorded run and compare it bit for bit"),
    "console": ("pa_ros.cli.console", "a page in the browser: a running graph, or a bag"),
    "mcp": ("pa_ros.cli.mcp", "tools for assistants (MCP): see, check, and if allowed execute"),
    "demo": ("pa_ros.cli.demo", "learn over the graph, then execute programs (make run)"),
}
# These import rclpy.
NEED_ROS = ("launch", "send", "scatter", "record", "play", "console", "mcp", "demo")
ABOUT = "Programmable agents: arms that execute declarative programs."
EXIT_REFUSED = 2  # the user's input was rejected; argparse has the same status
EXIT_PIPE = 141  # the status that a shell gives for SIGPIPE


class _CommandParser(argparse.ArgumentParser):
    """A parser whose errors are one line, and suggest a name for a misspelled one."""

    def error(self, message: str) -> NoReturn:
        raise ConfigError(f"{message} (see {self.prog} --help)")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:
            name = unknown[0].partition("=")[0]
            self.error(f"unknown argument {name}{did_you_mean(name, self._option_string_actions)}")
        return options, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            names = list(map(str, action.choices))
            hint = did_you_mean(str(value), names)
            text = f"expected one of {', '.join(names)}, got {value!r}{hint}"
            raise argparse.ArgumentError(action, text)


def build_parser(chosen: str | None) -> argparse.ArgumentParser:
    """The parser; only the chosen command's module is imported, since torch and rclpy are slow."""
    from pa_ros.cli.options import add_extension

    parser = _CommandParser(prog="pa_ros", description=ABOUT, allow_abbrev=False)
    parser.add_argument("--version", action="version", version=f"pa_ros {__version__}")
    add_extension(parser)
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (module, summary) in COMMANDS.items():
        subparser = subparsers.add_parser(
            name, help=summary, description=summary, allow_abbrev=False
        )
        if name == chosen:
            import_command(module).add_arguments(subparser)
            add_extension(subparser)
    return parser


def load_extensions(arguments: Sequence[str]) -> list[str]:
    """Import the extensions, which add to the choices of options, and return their names."""
    from pa_ros.cli.options import add_extension
    from pa_ros.core import extensions

    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    add_extension(parser)
    given: list[str] = parser.parse_known_args(arguments)[0].extension
    extensions.load(given)
    return given


def _run(arguments: Sequence[str], chosen: str | None) -> int:
    check_opengl()
    if chosen in NEED_ROS:
        require_ros()
    given = load_extensions(arguments)
    options = build_parser(chosen).parse_args(arguments)
    options.extension = given  # also those before the command's name
    return int(import_command(COMMANDS[options.command][0]).run(options))


def complete() -> None:
    """Answer a shell that asks for completions (argcomplete); the process then ends."""
    if "_ARGCOMPLETE" not in os.environ:
        return
    import argcomplete

    words = os.environ.get("COMP_LINE", "").split()
    argcomplete.autocomplete(build_parser(next((w for w in words if w in COMMANDS), None)))


def main(argv: Sequence[str] | None = None) -> int:
    """Run one subcommand; returns its exit status (2: the input was refused)."""
    complete()
    open_standard_streams()
    arguments = list(sys.argv[1:] if argv is None else argv)
    # The command is looked for before parsing, because the parser imports only its module.
    chosen = next((a for a in arguments if a in COMMANDS), None)
    command = f"pa_ros {chosen}" if chosen else "pa_ros"
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # our texts contain … and —
    try:
        with signals_interrupt():
            status = _run(arguments, chosen)
        sys.stdout.flush()
        return status
    except PaError as error:
        print(f"{command}: {printable_lines(str(error))}", file=sys.stderr)
        return EXIT_REFUSED
    except Interrupted as interrupted:
        return interrupted.status
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader, such as `| head`, has ended
        _say_no_more()
        return EXIT_PIPE
    except OSError as error:
        if error.filename is None:
            raise
        print(f"{command}: {printable_lines(str(error))}", file=sys.stderr)
        return EXIT_REFUSED  # a path that the system rejects


def _say_no_more() -> None:
    """Discard what standard output has not written yet, also when the interpreter ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
