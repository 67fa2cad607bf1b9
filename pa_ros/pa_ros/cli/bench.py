"""`pa_ros bench codec|sim|graph`: the figures of this machine."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from pa_ros.core.report import Report, device, versions, write_report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros bench`."""
    parser.add_argument("what", choices=sorted(BENCHMARKS))
    parser.add_argument("--json", type=Path, help="also write the figures to this file")


def _codec() -> Report:
    from pa_ros.wire.bench import bench_codec

    return bench_codec()


def _sim() -> Report:
    from pa_ros.arena.bench import bench_sim

    return bench_sim()


def _graph() -> Report:
    from pa_ros.ros.bench import bench_graph

    return bench_graph()


BENCHMARKS = {"codec": _codec, "sim": _sim, "graph": _graph}


def run(options: argparse.Namespace) -> int:
    """Measure, print, and write."""
    threads = os.environ.setdefault("OMP_NUM_THREADS", "1")  # before torch or MuJoCo load
    report = BENCHMARKS[options.what]()
    write_report(
        options.json, {**report, "device": device(), "threads": threads, "versions": versions()}
    )
    return 0
