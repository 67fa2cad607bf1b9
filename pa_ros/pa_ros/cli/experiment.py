"""`pa_ros experiment NAME`: several seeds of one setting, a table, and when each was solved."""

from __future__ import annotations

import argparse
import logging
import os
from pathlib import Path

from pa_ros.core.errors import ConfigError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros experiment`."""
    from pa_ros.evaluation.experiments import EXPERIMENTS

    parser.add_argument("name", help=", ".join(EXPERIMENTS))
    parser.add_argument("--seeds", type=int, default=3, metavar="N", help="(%(default)s)")
    parser.add_argument("--first-seed", type=int, default=0, metavar="S", help="(%(default)s)")
    parser.add_argument("--frames", type=int, help="of each seed (default: the experiment's)")
    parser.add_argument("--runs", type=Path, default=Path("runs/experiments"), help="raw runs")
    parser.add_argument(
        "--table", type=Path, help="CSV to write (default: docs/results/NAME.csv)"
    )


def run(options: argparse.Namespace) -> int:
    """Run the seeds that are missing; print when each was solved."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    from dataclasses import replace

    from pa_ros.evaluation.experiments import (
        experiment_named,
        read_curve,
        run_seed,
        summarize,
        write_table,
    )

    if options.seeds < 1 or options.first_seed < 0:
        raise ConfigError(
            "experiment: expected --seeds of at least 1 and --first-seed of at least 0, "
            f"got {options.seeds} and {options.first_seed}"
        )
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    experiment = experiment_named(options.name)
    if options.frames is not None:
        experiment = replace(experiment, frames=options.frames)
    table = options.table or Path("docs/results") / f"{experiment.name}.csv"
    print("seed  solved  frames  wall clock  held out  train   (normalized, at the end)")
    curves = {}
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        curve = run_seed(experiment, seed, options.runs / experiment.name / f"seed-{seed}")
        curves[seed] = read_curve(curve)
        row = summarize(seed, curves[seed])
        print(f"{seed:4d}  {'yes' if row.solved else 'no ':6s}  {row.frames_to_solve:6.0f}  "
              f"{row.wall_s_to_solve:8.0f} s  {row.held_out_at_end:8.2f}  {row.train_at_end:5.2f}",
              flush=True)  # fmt: skip
        write_table(table, experiment, curves)
    return 0
