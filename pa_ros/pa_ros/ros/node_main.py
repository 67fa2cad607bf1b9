"""The `main` of every node: environment, signals, exit status, and its launcher's end."""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pkgutil import resolve_name
from types import FrameType
from typing import TYPE_CHECKING, Any

from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.signals import on_ending
from pa_ros.ros.environment import (
    LOOPBACK_PROFILE,
    PROFILE,
    prepare_environment,
    require_ros,
    start_ros,
)

if TYPE_CHECKING:  # this import takes time, in which no signal is handled
    from pa_ros.core.settings import Settings

EXIT_REFUSED = 2  # the user's input was refused; the same status as argparse's
PARENT = "PA_ROS_PARENT"  # process id of the launcher that a process must end with
PARENT_CHECK_S = 0.25


def run_node(
    name: str,
    *makes: str | Callable[[], Any],
    settings: str = "",
    arguments: Sequence[str] | None = None,
    grace_s: float = 10.0,
    lingers_s: float = 0.0,
) -> int:
    """Run nodes on one executor until SIGINT, SIGTERM or SIGHUP; the exit status of the process.

    Where nodes ran on this machine alone, the process ends here, without C++'s static destructors:
    one node in some thousand crashed after it had closed, perhaps in them. On other networks they
    are needed, since they remove the middleware's shared memory.

    0: stopped as asked, unless a node's `close` returns another status. 1: the nodes took longer
    than `grace_s` to close, and were ended. 2: an argument or parameter was refused, with the
    reason on standard error, or a node set `ended_by`.

    :param name: of the program.
    :param makes: what makes the nodes, or its "module:name". They are rclpy nodes with a method
        `close`, which stops threads and saves; it is called in the reverse order.
    :param settings: "module:Class" of the parameters that `--help` prints.
    :param lingers_s: how long the nodes continue when their launcher has ended.
    """
    with _stop_on_signal(grace_s) as stop:
        prepare_environment()
        die_with_parent(grace_s, lingers_s)
        given = [name, *(sys.argv[1:] if arguments is None else arguments)]
        try:
            require_ros()
            from pa_ros.ros.executor import spin_until

            words = _words_not_of_ros(given)
            if {"-h", "--help"} & set(words):
                print(usage(name, resolve_name(settings) if settings else None))
                return 0
            if words:
                raise ConfigError(f"arguments: expected --ros-args or --help, got {words[0]!r}")
            start_ros(given)
            nodes: list[Any] = []
            try:
                for make in makes:
                    nodes.append((resolve_name(make) if isinstance(make, str) else make)())
                # A full garbage collection would stall a control step, so what exists is exempt.
                gc.collect()
                gc.freeze()
                spin_until(
                    nodes[0],
                    lambda: stop.is_set() or _ended_by(nodes) is not None,
                    None,
                    *nodes[1:],
                )
            finally:
                status = _close(nodes)
            if (ended := _ended_by(nodes)) is not None:
                raise ended
        except PaError as error:
            print(f"{name}: [{error.code}] {error}", file=sys.stderr)
            return EXIT_REFUSED
    if os.environ.get(PROFILE) == str(LOOPBACK_PROFILE):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    return status


def _ended_by(nodes: Sequence[Any]) -> PaError | None:
    """The error by which one of the nodes asked to end the process."""
    errors = (getattr(node, "ended_by", None) for node in nodes)
    return next((error for error in errors if error is not None), None)


def _close(nodes: Sequence[Any]) -> int:
    """Close and destroy nodes, the newest first, and end ROS; the exit status of the process."""
    import rclpy

    from pa_ros.ros.executor import release

    try:
        return max((node.close() or 0 for node in reversed(nodes)), default=0)
    finally:
        if nodes:
            release(nodes[0])
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


def usage(name: str, settings: type[Settings] | None = None) -> str:
    """The text of `--help`: how to start a node, and its parameters."""
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


def die_with_parent(grace_s: float = 10.0, lingers_s: float = 0.0) -> None:
    """End this child process, as at SIGTERM, when its launcher has ended.

    A learner then still writes its checkpoint, and a recorder closes its bag. The signal comes
    `lingers_s` later, for a process that needs the last messages of others; a process that hasn't
    ended `grace_s` after that is killed. Processes without PA_ROS_PARENT are not affected.
    """
    given = os.environ.pop(PARENT, None)
    if given is None:
        return
    parent = int(given)
    if os.getppid() != parent:
        raise SystemExit(1)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_CHECK_S)
        time.sleep(lingers_s)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(grace_s)
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=watch, name="parent", daemon=True).start()


def _words_not_of_ros(given: Sequence[str]) -> Sequence[str]:
    """The arguments that ROS doesn't know; none if ROS will refuse the command line itself."""
    from rclpy.utilities import remove_ros_args

    if "--ros-args" not in given:
        return given[1:]
    try:
        words: list[str] = remove_ros_args(given)[1:]
    except RuntimeError:
        return ()
    return words


@contextmanager
def _stop_on_signal(grace_s: float) -> Iterator[threading.Event]:
    """An event that is set by a signal to end; the process ends at the latest `grace_s` later."""
    stop = threading.Event()

    def handle(_number: int, _frame: FrameType | None) -> None:
        if not stop.is_set():
            last_resort = threading.Timer(grace_s, os._exit, (1,))
            last_resort.daemon = True
            last_resort.start()
        stop.set()

    with on_ending(handle):
        yield stop
