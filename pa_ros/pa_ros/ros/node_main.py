"""The `main` of every node: environment, context, signals, exit status."""

from __future__ import annotations

import gc
import json
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Any, Protocol

from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.signals import on_ending
from pa_ros.ros.environment import prepare_environment, start_ros
from pa_ros.ros.process import die_with_parent

if TYPE_CHECKING:  # its import takes time, in which no signal is handled
    from pa_ros.core.settings import Settings

EXIT_REFUSED = 2  # the user's input was refused, as argparse does


class Shell(Protocol):
    """A node of ours: a rclpy node, and what is to be closed before it goes."""

    def close(self) -> int | None:
        """Stop threads, save what must be saved; called once, before the node is destroyed.

        The process's exit status, if it is to be another than 0.
        """


def run_node(
    name: str,
    make: Callable[[], Shell],
    settings: Callable[[], type[Settings]] | None = None,
    arguments: Sequence[str] | None = None,
    grace_s: float = 10.0,
    lingers_s: float = 0.0,
) -> int:
    """Run one node in this process; see `run_nodes`."""
    return run_nodes(name, [make], settings, arguments, grace_s, lingers_s)


def run_nodes(
    name: str,
    makes: Sequence[Callable[[], Shell]],
    settings: Callable[[], type[Settings]] | None = None,
    arguments: Sequence[str] | None = None,
    grace_s: float = 10.0,
    lingers_s: float = 0.0,
) -> int:
    """Run nodes on one executor until SIGINT, SIGTERM or SIGHUP; the process's exit status.

    Nodes are closed in the reverse of the order in which they were made.

    0: stopped as asked, or what the node's `close` says instead. 2: a parameter was refused, with
    the reason on standard error. Should closing hang for `grace_s`, the process ends all the same
    (status 1). A node that sets `ended_by`, a PaError, ends as if a parameter was refused. When its
    launcher has gone it goes on for `lingers_s`. `--help` prints what parameters there are, those
    of `settings`, and any other word that is not ROS's is refused.
    """
    with _stop_on_signal(grace_s) as stop:
        prepare_environment()
        die_with_parent(grace_s, lingers_s)
        import rclpy

        from pa_ros.ros.executor import spin_until

        given = [name, *(sys.argv[1:] if arguments is None else arguments)]
        own = _own_words(given)
        if {"-h", "--help"} & set(own):
            print(usage(name, settings and settings()))
            return 0
        try:
            if own:
                raise ConfigError(f"arguments: expected --ros-args or --help, got {own[0]!r}")
            start_ros(given)
            nodes: list[Any] = []
            try:
                for make in makes:
                    nodes.append(make())
                gc.collect()
                gc.freeze()  # what is there now stays; a full collection would stall a step
                spin_until(
                    nodes[0],
                    lambda: stop.is_set() or _ended_by(nodes) is not None,
                    None,
                    *nodes[1:],
                )
            finally:
                status = _close(nodes)
            if (error := _ended_by(nodes)) is not None:
                raise error
        except PaError as error:
            print(f"{name}: [{error.code}] {error}", file=sys.stderr)
            return EXIT_REFUSED
        finally:
            rclpy.try_shutdown()
    return status


def _ended_by(nodes: Sequence[Any]) -> PaError | None:
    """The error by which one of the nodes asked to end the process."""
    errors = (getattr(node, "ended_by", None) for node in nodes)
    return next((error for error in errors if error is not None), None)


def _close(nodes: Sequence[Any]) -> int:
    """Close and destroy nodes, the newest first; the process's exit status."""
    from pa_ros.ros.executor import release

    try:
        return max((node.close() or 0 for node in reversed(nodes)), default=0)
    finally:
        if nodes:
            release(nodes[0])
        for node in nodes:
            node.destroy_node()


def _own_words(given: Sequence[str]) -> Sequence[str]:
    """What of a command line is not ROS's; nothing of one that its init will refuse."""
    from rclpy.utilities import remove_ros_args

    if "--ros-args" not in given:
        return given[1:]
    try:
        own: list[str] = remove_ros_args(given)[1:]
    except RuntimeError:
        return ()
    return own


def usage(name: str, settings: type[Settings] | None = None) -> str:
    """What `--help` prints: how a node is started, and its parameters."""
    lines = [
        f"usage: {name} [--ros-args [--params-file FILE] [-p PARAMETER:=VALUE] [-r FROM:=TO] …]",
        "",
        "A ROS 2 node: it runs until Ctrl-C. Parameters, defaults in brackets:",
    ]
    for leaf in settings.leaves() if settings else ():
        lines += [
            f"  {leaf.path} [{json.dumps(leaf.default)}]",
            f"      {leaf.expected}: {leaf.description}",
        ]
    return "\n".join(lines)


@contextmanager
def _stop_on_signal(grace_s: float) -> Iterator[threading.Event]:
    """An event that a signal to end sets, the process ending `grace_s` later come what may."""
    stop = threading.Event()

    def handle(_number: int, _frame: FrameType | None) -> None:
        if not stop.is_set():
            last_resort = threading.Timer(grace_s, os._exit, (1,))
            last_resort.daemon = True
            last_resort.start()
        stop.set()

    with on_ending(handle):
        yield stop
