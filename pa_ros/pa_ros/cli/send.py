"""`pa_ros send TEXT`: hand a program to a running graph, and see what becomes of it."""

from __future__ import annotations

import argparse
import sys

from pa_ros.cli.options import add_setting, settings_from
from pa_ros.tools.client import client_node
from pa_ros.tools.execution import Execution
from pa_ros.tools.send import Answers, ProgramSender, SendOptions, SendTimeoutError

EXIT_NOT_SATISFIED, EXIT_REFUSED, EXIT_TIMED_OUT = 1, 2, 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros send`."""
    parser.add_argument("text", help='a program: "NEAR(HAND, AND(RED, CUBE))"')
    add_setting(parser, SendOptions, "wait")
    add_setting(parser, SendOptions, "timeout_s", "--timeout", metavar="S")
    parser.add_argument("--namespace", default="", help="of the arena (default: none)")
    parser.epilog = (
        "exit status: 0 accepted (with --wait: satisfied), 1 not satisfied, 2 refused, 3 timed out"
    )


def run(options: argparse.Namespace) -> int:
    """Send, print each node's answer, wait for the verdict if asked to."""
    how = settings_from(options, SendOptions)
    with client_node("send", options.namespace) as node:
        sender = ProgramSender(node)
        try:
            try:
                answers = sender.send(options.text, how.timeout_s)
            finally:
                print_answers(sender.answers)
            if answers.refused:
                return EXIT_REFUSED
            if not how.wait:
                return 0
            execution = sender.wait(how.timeout_s)
        except SendTimeoutError as error:
            print(f"timed out: {error}", file=sys.stderr)
            return EXIT_TIMED_OUT
    print(execution_text(execution))
    return 0 if execution.satisfied else EXIT_NOT_SATISFIED


def print_answers(answers: Answers) -> None:
    """Acceptance on standard output, refusals with their caret on standard error."""
    for name, judgement in sorted(answers.judgements.items()):
        if judgement.accepted:
            print(f"{name}: accepted {judgement.canonical}")
        else:
            print(f"{name}: refused [{judgement.code}]\n{judgement.reason}", file=sys.stderr)


def execution_text(execution: Execution) -> str:
    """One line: the verdict, the distance, the time to reach."""
    where = f"distance {execution.distance:.3f} m after {execution.watched_s:.1f} s"
    if execution.satisfied:
        return f"satisfied: {where}, reached after {execution.reached_s:.1f} s"
    return f"not satisfied: {where} (ended by: {execution.ended})"
