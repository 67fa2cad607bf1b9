"""`pa_ros record OUT`: the graph into a rosbag2 bag, or a killed recording repaired."""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path

from pa_ros.bags.repair import repair
from pa_ros.cli.options import add_setting, add_settings, asked, settings_from
from pa_ros.core.errors import ConfigError
from pa_ros.tools.record import Recorder, RecordingOptions, topics_named, topics_of

EXIT_FAILED = 1
REFRESH_S = 0.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros record`."""
    parser.add_argument("out", type=Path, metavar="OUT", help="folder of the bag; must not exist")
    parser.add_argument(
        "--repair", action="store_true", help="make the bag OUT, whose recorder was killed, whole"
    )
    add_settings(parser, RecordingOptions, "topics", "namespace", "arenas", "split_mb", "split_s")
    add_setting(parser, RecordingOptions, "duration_s", "--duration")
    parser.epilog = "Ctrl-C or SIGTERM closes the bag; exit status 1 if recording ended by itself"


def run(options: argparse.Namespace) -> int:
    """Record until a signal comes, the time is up, or the disk is full."""
    if options.repair:
        if unused := asked(options, RecordingOptions):
            raise ConfigError(f"record --repair: expected it alone, got {', '.join(unused)}, too")
        return _repair(options.out)
    return _record(options, settings_from(options, RecordingOptions))


def _repair(folder: Path) -> int:
    done = repair(folder)
    for note in done.notes:
        print(note)
    print(f"{folder}: {done.messages} messages in {done.files} file(s) can be read")
    return 0


def _record(options: argparse.Namespace, how: RecordingOptions) -> int:
    from pa_ros.core.signals import signals_noted
    from pa_ros.ros.node_main import die_with_parent
    from pa_ros.tools.client import client_node
    from pa_ros.tools.monitor import Display

    die_with_parent()
    with signals_noted() as interrupted, client_node("record", how.namespace) as node:
        chosen = topics_of(how.arenas)
        if how.topics:
            chosen = tuple(topics_named(node, how.topics, how.arenas))
        with Recorder(options.out, node, chosen, how) as recorder:
            print(f"recording into {options.out} (Ctrl-C closes it)", flush=True)
            ends = time.monotonic() + (how.duration_s or math.inf)
            with Display(
                "Recording (Ctrl-C closes the bag)", recorder.rows, recorder.line
            ) as shown:
                while not (interrupted() or recorder.failure or time.monotonic() >= ends):
                    time.sleep(REFRESH_S)
                    shown.refresh()
    print(recorder.line())
    if recorder.failure is not None:
        print(f"pa_ros record: {recorder.failure}", file=sys.stderr)
        return EXIT_FAILED
    return 0
