"""`pa_ros train`: the same loop as the graph's, in one process."""

from __future__ import annotations

import argparse
import logging
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import numpy as np

from pa_ros.arena import DESIGNS, ArenaConfig, Design, ReachTask, design_named, preset_named
from pa_ros.bags.run_log import RunLog
from pa_ros.cli import from_bag
from pa_ros.evaluation.scoring.training import TrainingScores, training_programs
from pa_ros.learning.loop import TrainConfig, train
from pa_ros.learning.protocols import PROTOCOLS, protocol_named, usual_protocol
from pa_ros.networks.config import KINDS

EXIT_UNRECORDED = 1  # the disk was full; the run itself is whole


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros train`."""
    parser.add_argument("--design", default="2-L", help=f"{', '.join(DESIGNS)} (%(default)s)")
    parser.add_argument("--preset", default="fast", help="arena: fast or paper (%(default)s)")
    parser.add_argument(
        "--protocol", help=f"{', '.join(PROTOCOLS)} (ours, or ours-slow for preset paper)"
    )
    parser.add_argument(
        "--network", default="programmable", help=f"{', '.join(KINDS)} (%(default)s)"
    )
    parser.add_argument("--seed", type=int, help="(0; with --from-bag, the recorded one)")
    parser.add_argument("--frames", type=int, default=100_000, help="(%(default)s)")
    parser.add_argument("--out", type=Path, required=True, help="folder for curve and checkpoint")
    parser.add_argument("--resume", action="store_true", help="go on from the checkpoint in OUT")
    parser.add_argument("--record", type=Path, metavar="BAG", help="record the run into a bag")
    parser.add_argument(
        "--from-bag", type=Path, nargs="+", metavar="BAG",
        help="no arena: learn from recorded transitions, with the first bag's settings and --set",
    )  # fmt: skip
    parser.add_argument(
        "--namespace", help="with --from-bag: of the arena, if several were recorded"
    )
    parser.add_argument("--eval-every", type=int, default=10_000, metavar="FRAMES")
    parser.add_argument("--eval-episodes", type=int, default=20, metavar="N")
    parser.add_argument("--checkpoint-every", type=int, default=50_000, metavar="FRAMES")
    parser.add_argument(
        "--set", action="append", default=[], metavar="learner.PART.NAME=VALUE", dest="options",
        help="replace a setting of learner or network (network.NAME=VALUE); repeatable",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Train to `--frames`; rows are logged as they are written to OUT/progress.csv."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    options.protocol = options.protocol or usual_protocol(options.preset)
    if options.from_bag:
        return from_bag.run(options)
    seed = options.seed or 0
    design, arena = design_named(options.design), preset_named(options.preset)
    protocol = protocol_named(options.protocol).with_options(options.options)
    config = TrainConfig(
        out=options.out,
        seed=seed,
        frames=options.frames,
        design=design.name,
        preset=arena.preset,
        evaluate_every_frames=options.eval_every,
        checkpoint_every_frames=options.checkpoint_every,
    )
    programs = training_programs(design)
    with _run_log(options, arena, design, seed, programs) as run_log:
        train(
            config,
            protocol.network_config(design.vocabulary, options.network),
            protocol.learner,
            ReachTask(arena, design, seed),
            np.array(arena.joint_speed_limits),
            programs,
            TrainingScores(arena, design, options.eval_episodes),
            options.resume,
            run_log,
        )
    return EXIT_UNRECORDED if run_log is not None and run_log.failure is not None else 0


def _run_log(
    options: argparse.Namespace, arena: ArenaConfig, design: Design, seed: int, programs: list[str]
) -> AbstractContextManager[RunLog | None]:
    if options.record is None:
        return nullcontext()
    told = ("protocol", "network", "options", "frames", "resume")
    parameters = {name: getattr(options, name) for name in told}
    return RunLog(options.record, arena, design, seed, programs, parameters)
