"""`pa_ros experiment NAME`: train several seeds of one setting, or study trained seeds."""

from __future__ import annotations

import argparse
import logging
import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pa_ros.cli.options import (
    add_learning,
    add_setting,
    add_settings,
    folder_to_write,
    learning_given,
)
from pa_ros.core.errors import ConfigError
from pa_ros.language import MIN_MAX, logic_named

if TYPE_CHECKING:
    from laboratory.studies.experiments import Experiment, SeedSummary

PUBLISHED = Path("docs/results")
STUDIES = ("generalization", "detectors", "equalities")  # of trained seeds
TABLES = ("variants", "algorithms")  # read tables that experiments wrote
STUDIED = "programmable-3D"  # unless another is named


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros experiment`."""
    from laboratory.studies.experiments import EXPERIMENTS
    from laboratory.studies.seeds import SeedsConfig
    from pa_ros.arena import ArenaChoice
    from pa_ros.evaluation.evaluate import EvaluationConfig
    from pa_ros.learning.config import TrainConfig

    names = (*EXPERIMENTS, *STUDIES, *TABLES)
    parser.add_argument("name", choices=names, metavar="NAME", help=", ".join(names))
    parser.add_argument(
        "--of", choices=EXPERIMENTS, default=STUDIED, metavar="NAME",
        help="the experiment whose trained seeds are studied (%(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--conditions", nargs="+", default=(), metavar="NAME",
        help="of generalization (all of the design)",
    )  # fmt: skip
    add_settings(parser, SeedsConfig, "seeds", "first_seed", "jobs")
    add_setting(parser, TrainConfig, "frames", otherwise="the experiment's")
    add_settings(parser, ArenaChoice, "arm", "preset")
    add_setting(parser, EvaluationConfig, "logic")
    parser.add_argument(
        "--tag", default="", help="part of the tables' names, if settings of learning are changed"
    )
    add_learning(parser, with_network=False)
    parser.add_argument(
        "--runs", type=folder_to_write, default=Path("runs/experiments"), metavar="DIR",
        help="folder of the training runs (%(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--cluster", metavar="HOST:PORT",
        help="train seeds, or score the agents of generalization, on the Ray cluster with this "
        "head, as many at a time as it has processors (processes on this machine)",
    )  # fmt: skip
    add_results(parser)


def add_results(parser: argparse.ArgumentParser) -> None:
    """Declare the folder of tables. Published tables are overwritten only with --publish."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        "--results", type=folder_to_write, default=Path("runs/experiments/results"),
        help="folder of the tables (%(default)s)",
    )  # fmt: skip
    group.add_argument(
        "--publish", dest="results", action="store_const", const=PUBLISHED,
        help=f"overwrite the tables in {PUBLISHED}, which RESULTS.md shows",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Train the missing seeds and write tables, or do a study of trained seeds."""
    # Seeds run side by side: more threads for each would only slow the others down.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if options.name == "variants":
        return _compare(options.results)
    if options.name == "algorithms":
        from laboratory.studies.results import write_algorithms

        print(write_algorithms("programmable-2L", options.results))
        return 0
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    if options.name in STUDIES:
        return _study(options, seeds)
    if options.logic != MIN_MAX.name:
        raise ConfigError(
            f"--logic: expected a study ({', '.join(STUDIES)}), since learning agents act by "
            f"products, got {options.name}"
        )
    return _train(options, seeds)


def _train(options: argparse.Namespace, seeds: Sequence[int]) -> int:
    """Train seeds, here or on a cluster. Tables are written even if some seeds failed."""
    from laboratory.studies.cluster import Cluster, train_seeds_on
    from laboratory.studies.seeds import folder_of, tabulate, train_seeds
    from laboratory.studies.zones import write_traces
    from pa_ros.arena.skills import SUCCESS
    from pa_ros.arena.zones import FormulaSkill

    experiment = _experiment(options, options.name)
    folder = options.runs / experiment.label
    _check_runs(experiment, {seed: folder_of(folder, seed) for seed in seeds})
    try:
        if options.cluster is None:
            train_seeds(experiment, seeds, folder, options.jobs, options.extension)
        else:
            with Cluster(options.cluster, options.extension) as cluster:
                train_seeds_on(cluster, experiment, seeds, folder)
    finally:
        if done := tabulate(experiment, seeds, folder, options.results, options.runs / "scores"):
            table, summaries = done
            print_summaries(summaries)
            print(table)
    if isinstance(experiment.task.skill, FormulaSkill):
        table = options.results / f"{experiment.label}-traces.csv"
        write_traces(table, {seed: folder_of(folder, seed) for seed in seeds})
        print(table)
    elif experiment.score == SUCCESS:
        print(_conditions(experiment, folder, seeds, options))
    return 0


def _conditions(
    experiment: Experiment, folder: Path, seeds: Sequence[int], options: argparse.Namespace
) -> Path:
    """Write how episodes end under every condition, or under a few for a variant."""
    from laboratory.studies.pushing import FEW, ends_of
    from laboratory.studies.seeds import folder_of
    from laboratory.studies.tables import write_rows
    from pa_ros.agents import load_agent

    agents = {seed: load_agent(folder_of(folder, seed)) for seed in seeds}
    conditions = FEW if experiment.tag else ()
    rows = ends_of(agents, options.runs / "scores", conditions=conditions)
    table: Path = options.results / f"{experiment.label}-conditions.csv"
    write_rows(table, rows)
    return table


def _experiment(options: argparse.Namespace, name: str) -> Experiment:
    """The experiment with the settings that were given."""
    from laboratory.studies.experiments import ABLATIONS, EXPERIMENTS, under_recipe
    from pa_ros.arena.skills import SUCCESS
    from pa_ros.learning.recipes import LearningSettings

    experiment = EXPERIMENTS[name]
    changes = learning_given(options, LearningSettings(algorithm=options.algorithm))
    if not changes and experiment.score == SUCCESS:
        changes = dict(ABLATIONS.get(options.tag, {}))
    if bool(changes) != bool(options.tag):
        raise ConfigError("--tag: expected together with changed settings of learning")
    experiment = under_recipe(experiment, options.recipe or experiment.recipe)
    experiment = replace(
        experiment,
        preset=options.preset or experiment.preset,
        arm=options.arm,
        algorithm=options.algorithm,
        options={**experiment.options, **changes},
        tag=options.tag,
    )
    if options.frames is None:
        return experiment
    switch = options.frames // 2 if experiment.switch_frames else 0
    return replace(experiment, frames=options.frames, switch_frames=switch)


def _check_runs(experiment: Experiment, runs: dict[int, Path], ended: bool = False) -> None:
    """Raise ConfigError if a run (by seed) has other settings, another seed or length."""
    from laboratory.studies.experiments import check_run
    from pa_ros.learning.errors import CheckpointError

    for seed, run in runs.items():
        try:
            check_run(experiment, seed, run, ended)
        except CheckpointError as error:
            raise ConfigError(f"{error}: use the same options, or another --runs") from error


def print_summaries(summaries: Sequence[SeedSummary]) -> None:
    """Print a line for each seed; `held out` and `train` are scores on fresh episodes."""
    print("seed  solved  frames  wall clock  held out  train")
    for row in summaries:
        print(f"{row.seed:4d}  {'yes' if row.solved else 'no ':6s}  "
              f"{_figure(row.frames_to_solve, 6)}  {_figure(row.wall_s_to_solve, 8, 0, ' s')}  "
              f"{_figure(row.final_held_out, 8, 2)}  {_figure(row.final_train, 5, 2)}")  # fmt: skip


def _figure(value: float, width: int, digits: int = 0, unit: str = "") -> str:
    """A number with its unit, or a dash for NaN."""
    text = "–" if math.isnan(value) else f"{value:.{digits}f}{unit}"
    return f"{text:>{width + len(unit)}}"


def _compare(results: Path) -> int:
    """Write a table of variants for each table without a tag that has any."""
    from laboratory.studies.results import write_variants
    from laboratory.studies.tables import EvaluationError, read_setting
    from laboratory.studies.variants import NO_VARIANTS

    written = 0
    for table in sorted(results.glob("*.json")):
        if read_setting(table).get("tag") != "":
            continue
        try:
            print(write_variants(table.stem, results))
            written += 1
        except EvaluationError as error:
            if error.code != NO_VARIANTS:
                raise
    if not written:
        print(f"variants: expected an experiment's tables with and without --tag in {results}")
    return int(not written)


def _study(options: argparse.Namespace, seeds: Sequence[int]) -> int:
    """Evaluate trained seeds."""
    from laboratory.studies import results
    from laboratory.studies.cluster import Cluster, score_on
    from laboratory.studies.seeds import folder_of
    from pa_ros.agents import load_agent
    from pa_ros.learning.folder import holds_checkpoint

    experiment, logic = _experiment(options, options.of), logic_named(options.logic)
    folder, scores = options.runs / experiment.label, options.runs / "scores"
    runs = {seed: folder_of(folder, seed) for seed in seeds}
    if untrained := [seed for seed, run in runs.items() if not holds_checkpoint(run)]:
        raise ConfigError(
            f"{options.name}: expected trained agents in {folder}, found none of seeds "
            f"{untrained}: first run `pa_ros experiment {options.of}` with the same options"
        )
    _check_runs(experiment, runs, ended=True)
    agents = {seed: load_agent(run, logic=logic) for seed, run in runs.items()}
    # Tables of agents that execute by another logic than the default have its name.
    suffix = f".{experiment.label}".replace(f".{STUDIED}", "")
    suffix += "" if logic == MIN_MAX else f".{logic.name}"
    if options.name == "detectors":
        results.detectors(agents, options.results, suffix=suffix)
    elif options.name == "equalities":
        results.equalities(agents, options.results, suffix=suffix)
    else:
        if options.cluster is not None:  # the cluster computes the scores that are read below
            with Cluster(options.cluster, options.extension) as cluster:
                score_on(cluster, runs, scores, conditions=options.conditions, logic=logic)
        for row in results.generalization(
            agents, options.results, scores, suffix=suffix, conditions=options.conditions
        ):
            print(f"{row.condition:16s} {row.normalized:5.2f} [{row.low:5.2f}, {row.high:5.2f}]  "
                  f"best blind {row.blind_normalized:5.2f}")  # fmt: skip
    return 0
