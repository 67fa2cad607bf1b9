"""`pa_ros bench NAME`: the figures of this machine."""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from pa_ros.cli.options import add_setting, file_to_write
from pa_ros.core.errors import ConfigError
from pa_ros.core.report import Report, write_report
from pa_ros.core.settings import Settings
from pa_ros.core.software import device, versions


class BenchConfig(Settings):
    """What some benchmarks ask for."""

    SECTION: ClassVar[str] = "bench"

    minutes: float = Field(
        0.0, ge=0, description="endurance: how long; console: for how long a page is open besides"
    )
    seeds: int = Field(3, ge=1, description="fleet: of each size; peers: of each contender")
    frames: int = Field(
        60_000, ge=2_500, description="peers: of each contender, scored every 2,500"
    )


USUAL: dict[str, Any] = {
    "network": "programmable",
    "graph": False,
    "growth": False,
    "arenas": [1, 2, 4, 8],
    "contenders": [],
    "seeds": BenchConfig.leaf("seeds").default,
    "frames": BenchConfig.leaf("frames").default,
    "minutes": None,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros bench`."""
    parser.add_argument("what", choices=sorted(BENCHMARKS))
    parser.add_argument("--json", type=file_to_write, help="also write the figures to this file")
    parser.add_argument("--network", help="learner, train: kind of networks (%(default)s)")
    parser.add_argument(
        "--graph", action="store_true", help="train: the three nodes as processes instead"
    )
    add_setting(parser, BenchConfig, "minutes", otherwise="60; 0")
    add_setting(parser, BenchConfig, "seeds")
    add_setting(parser, BenchConfig, "frames")
    parser.add_argument(
        "--arenas", type=int, nargs="+", metavar="N",
        help="fleet: how many, at ten times real time (%(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--contenders", nargs="+", metavar="NAME", help="peers: these alone (every one)"
    )
    parser.add_argument(
        "--growth", action="store_true",
        help="learner: time of an update against blocks, batch and programs; "
        "with --json a picture beside it",
    )  # fmt: skip
    parser.set_defaults(**USUAL)


def _codec(_: argparse.Namespace) -> Report:
    from pa_ros.benchmarks.codec import bench_codec

    return bench_codec()


def _endurance(options: argparse.Namespace) -> Report:
    from pa_ros.benchmarks.endurance import CAPACITY, bench_endurance
    from pa_ros.benchmarks.endurance_figure import draw_endurance

    minutes = 60.0 if options.minutes is None else options.minutes
    if not minutes:
        raise ConfigError("--minutes: expected a positive number for endurance, got 0")
    report, samples = bench_endurance(minutes)
    if options.json is not None:
        draw_endurance(options.json.with_suffix(".png"), samples, CAPACITY)
    return report


def _sim(_: argparse.Namespace) -> Report:
    from pa_ros.benchmarks.arena import bench_sim

    return bench_sim()


def _graph(_: argparse.Namespace) -> Report:
    from pa_ros.benchmarks.graph import bench_graph

    return bench_graph()


def _latency(_: argparse.Namespace) -> Report:
    from pa_ros.benchmarks.latency import bench_latency

    return bench_latency()


def _learner(options: argparse.Namespace) -> Report:
    from pa_ros.benchmarks.design import bench_growing, bench_updates

    if not options.growth:
        return bench_updates(options.network)
    return bench_growing(options.network, options.json and options.json.with_suffix(".png"))


def _train(options: argparse.Namespace) -> Report:
    from pa_ros.benchmarks.design import bench_graph_loop, bench_loop

    return (bench_graph_loop if options.graph else bench_loop)(options.network)


def _fleet(options: argparse.Namespace) -> Report:
    from pa_ros.benchmarks.fleet import bench_fleet, runs_in
    from pa_ros.benchmarks.fleet_figure import draw_fleet

    if options.json is None:
        with tempfile.TemporaryDirectory() as name:
            return bench_fleet(Path(name), options.seeds, options.arenas)
    folder = options.json.with_suffix(".runs")
    report = bench_fleet(folder, options.seeds, options.arenas)
    draw_fleet(options.json.with_suffix(".png"), runs_in(folder))
    return report


def _load(_: argparse.Namespace) -> Report:
    from pa_ros.benchmarks.load import bench_load

    return bench_load()


def _console(options: argparse.Namespace) -> Report:
    from pa_ros.benchmarks.console import bench_console

    return bench_console(minutes=options.minutes or 0.0)


def _peers(options: argparse.Namespace) -> Report:
    from pa_ros.benchmarks.peers import bench_peers, scores_in
    from pa_ros.benchmarks.peers_figure import draw_peers

    if options.json is None:
        with tempfile.TemporaryDirectory() as name:
            return bench_peers(Path(name), options.seeds, options.contenders, options.frames)
    folder = options.json.with_suffix(".runs")
    found = bench_peers(folder, options.seeds, options.contenders, options.frames)
    draw_peers(options.json.with_suffix(".png"), scores_in(folder))
    return found


def _relations(_: argparse.Namespace) -> Report:
    from pa_ros.benchmarks.relations import bench_relations

    return bench_relations()


BENCHMARKS = {
    "codec": _codec,
    "console": _console,
    "endurance": _endurance,
    "fleet": _fleet,
    "sim": _sim,
    "graph": _graph,
    "latency": _latency,
    "learner": _learner,
    "load": _load,
    "peers": _peers,
    "relations": _relations,
    "train": _train,
}


USED = {  # options by benchmark; the others have none but --json
    "console": {"minutes"},
    "endurance": {"minutes"},
    "fleet": {"seeds", "arenas"},
    "learner": {"network", "growth"},
    "peers": {"seeds", "contenders", "frames"},
    "train": {"network", "graph"},
}


def run(options: argparse.Namespace) -> int:
    """Measure, print, and write."""
    unused = {name for name, usual in USUAL.items() if getattr(options, name) != usual}
    if unused := unused - USED.get(options.what, set()):
        raise ConfigError(f"bench {options.what}: expected no --{', --'.join(sorted(unused))}")
    threads = os.environ.setdefault("OMP_NUM_THREADS", "1")  # before torch or MuJoCo load
    report = BENCHMARKS[options.what](options)
    write_report(
        options.json, {**report, "device": device(), "threads": threads, "versions": versions()}
    )
    return 0
