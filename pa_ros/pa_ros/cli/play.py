"""`pa_ros play BAG`: a recording back into a live graph."""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path

from pa_ros.bags.reader import Bag
from pa_ros.cli.options import add_setting, add_settings, settings_from
from pa_ros.tools.playback import PlaybackOptions, Player


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros play`."""
    parser.add_argument("bag", type=Path, metavar="BAG")
    add_settings(parser, PlaybackOptions, "rate", "topics", "loop", "clock")
    for name in ("start", "duration", "wait"):
        add_setting(parser, PlaybackOptions, f"{name}_s", f"--{name}", metavar="S")


def run(options: argparse.Namespace) -> int:
    """Play until the end or a signal."""
    from pa_ros.core.signals import signals_noted
    from pa_ros.tools.client import client_node

    how = settings_from(options, PlaybackOptions)
    with Bag(options.bag) as bag, signals_noted() as interrupted, client_node("play") as node:
        player = Player(bag, node, how)
        for name, reason in player.played.left_out.items():
            print(f"warning: {name} is left out: {reason}")
        started = time.monotonic()
        played = player.run(interrupted)
        wall_s = time.monotonic() - started
    for name in played.without_subscriber:
        print(f"warning: {name} had no subscriber when playback began")
    late = [1e3 * value for value in played.late_s]
    error = f", timing error {statistics.median(late):.3f} ms in the median" if late else ""
    print(f"{sum(played.counts.values())} messages in {wall_s:.1f} s{error}")
    return 0
