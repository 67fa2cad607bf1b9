"""`pa_ros send TEXT`: send a program to a running graph and show the outcome.

Without a text it shows what is on the table, and programs that make sense there.
"""

from __future__ import annotations

import argparse
import math
import sys
import time

from pydantic import Field

from pa_ros.acting.execution import Result
from pa_ros.cli.options import add_setting, settings_from
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.settings import Settings
from pa_ros.core.text import printable, printable_lines
from pa_ros.tools.arm import Arm
from pa_ros.tools.client import NoAnswerError
from pa_ros.tools.send import Answers
from pa_ros.wire.program import GoalProgress
from pa_ros.wire.services import ResetRequest
from pa_ros.world.relation import measured

EXIT_NOT_SATISFIED, EXIT_REFUSED, EXIT_TIMED_OUT = 1, 2, 3


class SendOptions(Settings):
    """Settings of sending."""

    timeout_s: float = Field(
        30.0, gt=0, description="seconds to wait for an arena, for answers, and for progress"
    )
    wait: bool = Field(False, description="send it as the agent's goal, and wait for the verdict")


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
        raise ConfigError("--wait: needs a program")
    try:
        with Arm(options.namespace, patience=how.timeout_s) as arm:
            if options.scene is not None:
                print(f"began episode {arm.reset(options.scene.episode).episode}")
            if options.text is None:
                print(arm.scene())
                return 0
            try:
                return _execute(arm, options.text) if how.wait else _send(arm, options.text)
            except NoAnswerError:
                raise
            except PaError as error:
                print(_refused(error.code, str(error)), file=sys.stderr)
            print(arm.scene().suggested(), file=sys.stderr)
            return EXIT_REFUSED
    except NoAnswerError as error:
        print(f"timed out: {printable(str(error))}", file=sys.stderr)
        return EXIT_TIMED_OUT


def _scene(text: str) -> ResetRequest:
    """`--scene`: ConfigError for neither `next` nor a number."""
    if text == "next":
        return ResetRequest()
    if not text.isdecimal():
        raise ConfigError(f"--scene: expected next or the number of an episode, got {text!r}")
    return ResetRequest(int(text))


def _execute(arm: Arm, text: str) -> int:
    """Execute the program to its end. Raises PaError if it is rejected."""
    result = arm.execute(text, progress=_Feedback(text))
    print(result_text(result))
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
        where = measured(self._program, progress.distance, progress.stage)
        if progress.stages > 1:
            where = f"stage {progress.stage + 1} of {progress.stages}: {where}"
        print(f"  {where}; p of {words or 'nothing yet'}", flush=True)


def _send(arm: Arm, text: str) -> int:
    """Publish the program, and print the answers."""
    try:
        answers = arm.send(text)
    finally:  # also after a timeout: some nodes may have answered
        print_answers(arm.answers)
    if answers.refused:
        print(arm.scene().suggested(), file=sys.stderr)
    return EXIT_REFUSED if answers.refused else 0


def result_text(result: Result) -> str:
    """One line: the verdict, the distance, the time to reach or the reason."""
    where = f"distance {measured(result.program, result.distance)}"
    if result.success:
        return f"satisfied: {where}, reached after {result.reached_s or 0.0:.1f} s"
    code = f" [{printable(result.code)}]" if result.code else ""
    return f"not satisfied: {where}: {printable(result.reason)}{code}"


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
