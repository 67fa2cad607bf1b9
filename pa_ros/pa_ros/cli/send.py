"""`pa_ros send TEXT`: send a program to a running graph and show the outcome.

Without a text it shows what is on the table, and programs that make sense there.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from functools import partial

from pa_ros.acting.execution import HOLD_S, WINDOW_S
from pa_ros.cli.options import add_setting, settings_from
from pa_ros.core.errors import ConfigError
from pa_ros.core.text import printable, printable_lines
from pa_ros.ros.executor import spin_until
from pa_ros.tools.client import (
    ArenaClient,
    NoAnswerError,
    Node,
    client_node,
    spin_with_notice,
)
from pa_ros.tools.scenes import Scene
from pa_ros.tools.send import (
    Answers,
    GoalClient,
    ProgramSender,
    SendOptions,
)
from pa_ros.wire.program import GoalProgress, GoalResult, ProgramGoal
from pa_ros.wire.services import ResetRequest
from pa_ros.world.relation import measured

SUGGEST_S = 2.0  # wait so long for a sample of the table
OFFER_S = 5.0  # wait so long for an agent's action
EXIT_NOT_SATISFIED, EXIT_REFUSED, EXIT_TIMED_OUT = 1, 2, 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros send`."""
    parser.add_argument(
        "text", nargs="?",
        help='a program: "NEAR(HAND, AND(RED, CUBE))"; without one, show what is on the '
        "table, and programs that make sense there",
    )  # fmt: skip
    parser.add_argument(
        "--scene", type=_scene, metavar="next|N",
        help="first begin the next scene, or that of episode N",
    )  # fmt: skip
    add_setting(parser, SendOptions, "wait")
    add_setting(parser, SendOptions, "timeout_s", "--timeout", metavar="S")
    parser.add_argument("--namespace", default="", help="of the arena (default: none)")
    parser.epilog = (
        "exit status: 0 accepted (with --wait: satisfied), 1 not satisfied, 2 rejected, 3 timed out"
    )


def run(options: argparse.Namespace) -> int:
    """Send the program, or a goal; print the answers and the outcome."""
    how = settings_from(options, SendOptions)
    if how.wait and options.text is None:
        raise ConfigError("--wait: expected a program with it")
    with client_node("send", options.namespace) as node:
        try:
            if options.scene is not None:
                arena = ArenaClient(node, partial(spin_with_notice, node))
                began = arena.reset(options.scene, how.timeout_s)
                print(f"began episode {began.episode}")
            scene = Scene(node)
            if options.text is None:
                return _describe(node, scene, how.timeout_s)
            status = _pursue(node, options.text, how) if how.wait else None
            status = _send(node, options.text, how) if status is None else status
            if status == EXIT_REFUSED and spin_until(node, lambda: scene.known, SUGGEST_S):
                print(_suggested(scene), file=sys.stderr)
            return status
        except NoAnswerError as error:
            print(f"timed out: {error}", file=sys.stderr)
            return EXIT_TIMED_OUT


def _scene(text: str) -> ResetRequest:
    """`--scene`: ConfigError for neither `next` nor a number."""
    if text == "next":
        return ResetRequest()
    if not text.isdecimal():
        raise ConfigError(f"--scene: expected next or the number of an episode, got {text!r}")
    return ResetRequest(int(text))


def _describe(node: Node, scene: Scene, timeout_s: float) -> int:
    """Print what is on the table. Raises NoAnswerError if no sample arrives in time."""
    if not spin_with_notice(node, lambda: scene.known, timeout_s):
        if scene.arena is not None:
            raise NoAnswerError(
                f"arena {printable(scene.arena.arena_id)} describes itself, but no observation of "
                f"it arrived within {timeout_s:g} s"
            )
        raise NoAnswerError(
            f"no arena within {timeout_s:g} s: does one run, in this ROS domain and namespace?"
        )
    for label, text in scene.rows():
        print(f"{label}: {text}")
    print(_suggested(scene))
    return 0


def _suggested(scene: Scene) -> str:
    return "\n  ".join(["programs that make sense now:", *scene.suggestions()])


def _pursue(node: Node, text: str, how: SendOptions) -> int | None:
    """Send a goal to the agent; None if it offers no action, as agents that learn do."""
    client = GoalClient(node, partial(spin_with_notice, node))
    try:
        if not client.offered(min(OFFER_S, how.timeout_s)):
            return None
        goal = ProgramGoal(text, WINDOW_S, HOLD_S)
        result = client.execute(goal, how.timeout_s, _Feedback(text))
    finally:
        client.close()
    if result.position >= 0 or result.code.startswith("program."):
        print(_refused(result.code, result.reason), file=sys.stderr)
        return EXIT_REFUSED
    print(result_text(text, result))
    return 0 if result.success else EXIT_NOT_SATISFIED


class _Feedback:
    """Prints the progress of a goal once a second, from its first step on."""

    def __init__(self, program: str) -> None:
        self._program, self._said_at = program, -math.inf

    def __call__(self, progress: GoalProgress) -> None:
        if not math.isfinite(progress.distance) or time.monotonic() - self._said_at < 1.0:
            return
        self._said_at = time.monotonic()
        meant = zip(progress.objects, progress.relevance, strict=False)
        words = ", ".join(f"{printable(name)} {p:.2f}" for name, p in meant if name != "hand")
        where = measured(self._program, progress.distance)
        print(f"  {where}; p of {words or 'nothing yet'}", flush=True)


def _send(node: Node, text: str, how: SendOptions) -> int:
    """Publish the program; with `wait`, follow the steps until the outcome is clear."""
    sender = ProgramSender(node, partial(spin_with_notice, node))
    try:
        answers = sender.send(text, how.timeout_s)
    finally:  # also after a timeout: some nodes may have answered
        print_answers(sender.answers)
    if answers.refused:
        return EXIT_REFUSED
    if not how.wait:
        return 0
    execution = sender.wait(how.timeout_s)
    print(execution.text(text))
    return 0 if execution.satisfied else EXIT_NOT_SATISFIED


def result_text(program: str, result: GoalResult) -> str:
    """One line: the verdict, the distance, the time to reach or the reason."""
    where = f"distance {measured(program, result.final_distance)}"
    if result.success:
        return f"satisfied: {where}, reached after {result.time_to_reach_s or 0.0:.1f} s"
    return f"not satisfied: {where}: {printable(result.reason)} [{printable(result.code)}]"


def print_answers(answers: Answers) -> None:
    """Acceptance on standard output, rejections with their caret on standard error.

    Nodes that give the same answer share a line.
    """
    nodes: dict[tuple[bool, str], list[str]] = {}
    for name, status in sorted(answers.statuses.items()):
        accepted = f"accepted {printable_lines(status.canonical)}"
        text = accepted if status.accepted else _refused(status.code, status.reason)
        nodes.setdefault((status.accepted, text), []).append(printable(name))
    for (is_accepted, text), names in nodes.items():
        print(f"{', '.join(names)}: {text}", file=sys.stdout if is_accepted else sys.stderr)


def _refused(code: str, reason: str) -> str:
    return f"refused [{printable(code)}]\n{printable_lines(reason)}"
