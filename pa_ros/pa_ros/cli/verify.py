"""`pa_ros verify BAG`: repeat a recorded run, and compare it to the last bit."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from pa_ros.bags.experience import Experience
from pa_ros.bags.reader import Bag
from pa_ros.bags.verify import Verification, verify

EXIT_DIFFERENT = 1
REPORT_S = 5.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros verify`."""
    parser.add_argument("bag", type=Path, metavar="BAG", help="a recording of a whole run")
    parser.add_argument("--namespace", help="namespace of the arena, if several were recorded")
    parser.add_argument(
        "--no-arena", action="store_true", help="compare only the weights, not the transitions"
    )
    parser.epilog = "exit status: 0 equal, 1 different or incomplete, 2 not a recorded run"


def run(options: argparse.Namespace) -> int:
    """Verify; prints hashes, and the first difference if there is one."""
    reported = time.monotonic()

    def report(found: Verification) -> None:
        nonlocal reported
        if time.monotonic() - reported >= REPORT_S:
            reported = time.monotonic()
            print(f"version {found.version}: {found.compared} equal", file=sys.stderr, flush=True)

    with Bag(options.bag) as bag:
        found = verify(Experience.read(bag, options.namespace), not options.no_arena, report)
    for line in conclusion(found):
        print(line)
    return 0 if found.equal else EXIT_DIFFERENT


def conclusion(found: Verification) -> list[str]:
    """The lines that are printed at the end."""
    lines = [
        found.note,
        f"repeated: {found.frames} transitions, {found.updates} updates, version {found.version}",
        f"compared with a fresh arena: {found.checked} transitions",
        f"newest weights compared, as recorded   {found.recorded or '-'}",
        f"newest weights compared, computed here {found.computed or '-'}",
        f"{found.compared} versions of the weights are equal",
    ]
    if found.difference:
        lines.append(f"DIFFERENT: the weights differ first at {found.difference}")
    if found.altered:
        lines.append(f"DIFFERENT: {found.altered} trajectories differ from what the arena gives:")
        lines += [f"  {name}" for name in found.named]
    if found.incomplete:
        lines.append(f"INCOMPLETE: {found.incomplete}")
    return [*lines, *(["EQUAL"] if found.equal else [])]
