"""`pa_ros play BAG`: a recording back into a live graph."""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path

from pa_ros.bags.reader import Bag
from pa_ros.cli.options import add_setting, add_settings, file_to_write, settings_from
from pa_ros.core.software import device, versions
from pa_ros.core.text import write_report
from pa_ros.tools.playback import PlaybackOptions, Played, Player


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros play`."""
    parser.add_argument("bag", type=Path, metavar="BAG")
    add_settings(parser, PlaybackOptions, "rate", "topics", "loop", "clock")
    for name in ("start", "duration", "wait"):
        add_setting(parser, PlaybackOptions, f"{name}_s", f"--{name}", metavar="S")
    parser.add_argument("--json", type=file_to_write, help="also write the figures to this file")


def run(options: argparse.Namespace) -> int:
    """Play until the end or a signal."""
    from pa_ros.core.signals import signals_noted
    from pa_ros.tools.client import client_node

    how = settings_from(options, PlaybackOptions)
    played = Played()
    with Bag(options.bag) as bag, signals_noted() as interrupted, client_node("play") as node:
        player = Player(bag, node, how)
        for name, reason in player.played.left_out.items():
            print(f"warning: {name} is left out: {reason}")
        started = time.monotonic()
        played = player.run(interrupted)
        wall_s = time.monotonic() - started
    for name in played.without_subscriber:
        print(f"warning: {name} had no subscriber when playback began")
    report: dict[str, float | int | str] = {
        "playback.wall_s": wall_s,
        "playback.messages": sum(played.counts.values()),
    }
    if played.late_s:
        late = [1e3 * value for value in played.late_s]
        report["playback.timing_error_ms_median"] = statistics.median(late)
        report["playback.timing_error_ms_max"] = max(late)
    report |= {f"playback.topic.{name}.messages": n for name, n in played.counts.items()}
    write_report(options.json, {**report, "device": device(), "versions": versions()})
    return 0
