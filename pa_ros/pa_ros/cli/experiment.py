"""`pa_ros experiment NAME`: several seeds of one setting, tables, and when each was solved."""

from __future__ import annotations

import argparse
import itertools
import logging
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pa_ros.cli.options import (
    add_learning,
    add_setting,
    add_settings,
    asked,
    file_to_write,
    folder_to_write,
    learning_given,
)
from pa_ros.core.errors import ConfigError
from pa_ros.core.text import write_report
from pa_ros.language import MIN_MAX, Logic, logic_named

if TYPE_CHECKING:
    from pa_ros.evaluation.experiments import Experiment, SeedSummary

PUBLISHED = Path("docs/results")
STUDIES = ("generalization", "detectors", "equalities")
OF_TABLES = ("variants", "algorithms", "summary")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros experiment`."""
    from pa_ros.arena import ArenaChoice
    from pa_ros.evaluation.evaluate import EvaluationConfig
    from pa_ros.evaluation.experiments import EXPERIMENTS
    from pa_ros.evaluation.seeds import SeedsConfig
    from pa_ros.learning.config import TrainConfig

    parser.set_defaults(names=(*EXPERIMENTS, *STUDIES, *OF_TABLES))
    parser.add_argument("name", metavar="NAME", help=", ".join(parser.get_default("names")))
    add_settings(parser, SeedsConfig, "seeds", "first_seed", "jobs")
    add_setting(parser, TrainConfig, "frames", otherwise="the experiment's")
    add_settings(parser, ArenaChoice, "arm", "preset")
    add_setting(parser, EvaluationConfig, "logic")
    parser.add_argument(
        "--conditions", nargs="+", default=(), metavar="NAME",
        help="generalization: these alone (every one)",
    )  # fmt: skip
    parser.add_argument(
        "--tag", default="", help="names the changed settings of learning, in the tables' names"
    )
    add_learning(parser, with_network=False)
    parser.add_argument(
        "--runs", type=folder_to_write, default=Path("runs/experiments"), metavar="DIR",
        help="of what is trained (%(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--cluster", metavar="HOST:PORT",
        help="seeds, and the agents of generalization, as tasks of the Ray cluster with this head, "
        "as many at a time as it has processors (processes of this machine)",
    )  # fmt: skip
    add_results(parser, "runs/experiments/results")
    parser.add_argument(
        "--json", type=file_to_write, help="summary: also write the figures to this file"
    )


def add_results(parser: argparse.ArgumentParser, default: str) -> None:
    """Declare where tables lie: never among the published ones, unless that is asked for."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        "--results",
        type=folder_to_write,
        default=Path(default),
        help="folder of the tables (%(default)s)",
    )
    group.add_argument(
        "--publish", dest="results", action="store_const", const=PUBLISHED,
        help=f"the tables in {PUBLISHED}, which RESULTS.md states: written over",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Run the seeds that are missing and write the tables; or a study of trained seeds."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if options.name not in options.names:
        names = ", ".join(options.names)
        raise ConfigError(f"experiment: expected one of {names}, got {options.name!r}")
    if options.name in OF_TABLES:
        _refuse_unused(options)
    if options.json is not None and options.name != "summary":
        raise ConfigError(f"experiment {options.name}: expected --json of summary alone")
    if options.name == "summary":
        return _summarize(options)
    if options.name == "variants":
        return _compare(options.results)
    if options.name == "algorithms":
        from pa_ros.evaluation.results import write_algorithms

        print(write_algorithms("programmable-2L", options.results))
        return 0
    if options.name not in STUDIES and options.logic != MIN_MAX.name:
        raise ConfigError(
            f"experiment {options.name}: expected --logic with one of {', '.join(STUDIES)} alone: "
            "who learns acts by products"
        )
    if bool(_changes(options)) != bool(options.tag):
        raise ConfigError(
            "experiment: expected --tag together with settings of learning, got one of them"
        )
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    if options.conditions and options.name != "generalization":
        raise ConfigError(
            f"experiment {options.name}: expected --conditions of generalization alone"
        )
    if options.name in STUDIES:
        return _study(options, seeds)
    from pa_ros.evaluation.seeds import folder_of, tabulate

    experiment = _experiment(options)
    folder = options.runs / experiment.label
    runs = {seed: folder_of(folder, seed) for seed in seeds}
    _check_runs(experiment, runs)  # first, since the table is made whatever becomes of the others
    try:
        _train(options, experiment, seeds, folder)
    finally:
        if done := tabulate(experiment, seeds, folder, options.results, options.runs / "scores"):
            table, summaries = done
            print_summaries(summaries)
            print(table)
    return 0


def _check_runs(experiment: Experiment, runs: Mapping[int, Path], ended: bool = False) -> None:
    """Raise ConfigError if one of them, by seed, is of another setting, seed or length."""
    from pa_ros.evaluation.experiments import check_run
    from pa_ros.learning.errors import CheckpointError

    for seed, run in runs.items():
        try:
            check_run(experiment, seed, run, ended)
        except CheckpointError as error:
            raise ConfigError(
                f"{error}: the same options, or another --runs, are needed"
            ) from error


def _train(
    options: argparse.Namespace, experiment: Experiment, seeds: Sequence[int], folder: Path
) -> None:
    """The seeds, in processes of this machine or on a cluster."""
    if options.cluster is None:
        from pa_ros.evaluation.seeds import train_seeds

        train_seeds(experiment, seeds, folder, options.jobs, options.extension)
        return
    from pa_ros.evaluation.cluster import Cluster, train_seeds_on

    with Cluster(options.cluster, options.extension) as cluster:
        train_seeds_on(cluster, experiment, seeds, folder)


def _refuse_unused(options: argparse.Namespace) -> None:
    """Raise ConfigError for what a look at tables would pass over."""
    from pa_ros.arena import ArenaChoice
    from pa_ros.evaluation.evaluate import EvaluationConfig
    from pa_ros.evaluation.seeds import SeedsConfig
    from pa_ros.learning.config import TrainConfig
    from pa_ros.learning.protocols import LearningSettings

    kinds = (ArenaChoice, EvaluationConfig, SeedsConfig, TrainConfig, LearningSettings)
    unused = {name for kind in kinds for name in asked(options, kind)}
    unused |= {name for name in ("conditions", "cluster", "tag") if getattr(options, name)}
    unused |= _changes(options).keys()
    if unused:
        names = ", --".join(sorted(unused)).replace("_", "-")
        raise ConfigError(f"experiment {options.name}: expected no --{names}: it reads tables")


def _summarize(options: argparse.Namespace) -> int:
    from pa_ros.evaluation.experiments import headline

    if not (found := headline(options.results)):
        raise ConfigError(
            "experiment summary: expected tables of programmable-2L or programmable-3D in "
            f"{options.results}, found none"
        )
    write_report(options.json, found)
    return 0


def _compare(results: Path) -> int:
    """Every programmable experiment beside its variants on that arm, where tables of any are."""
    from pa_ros.arena import PRESETS
    from pa_ros.evaluation.experiments import experiment_named
    from pa_ros.evaluation.results import write_variants
    from pa_ros.evaluation.tables import EvaluationError
    from pa_ros.evaluation.variants import NO_VARIANTS

    written, missing = 0, []
    for name, preset in itertools.product(("programmable-2L", "programmable-3D"), PRESETS):
        try:
            label = replace(experiment_named(name), preset=preset).label
            print(write_variants(label, results))
            written += 1
        except EvaluationError as error:
            if error.code != NO_VARIANTS:
                raise
            missing.append(str(error))
    if not written:
        print("\n".join(missing))
    return int(not written)


def _changes(options: argparse.Namespace) -> dict[str, Any]:
    """The settings of learning that were given, by dotted name."""
    from pa_ros.learning.protocols import LearningSettings

    return learning_given(options, LearningSettings(algorithm=options.algorithm))


def _experiment(options: argparse.Namespace) -> Experiment:
    from pa_ros.evaluation.experiments import experiment_named, under_protocol

    experiment = under_protocol(experiment_named(options.name), options.protocol)
    experiment = replace(
        experiment,
        preset=options.preset,
        arm=options.arm,
        algorithm=options.algorithm,
        options={**experiment.options, **_changes(options)},
        tag=options.tag,
    )
    if options.frames is None:
        return experiment
    switch = options.frames // 2 if experiment.switch_frames else 0
    return replace(experiment, frames=options.frames, switch_frames=switch)


def print_summaries(summaries: Sequence[SeedSummary]) -> None:
    """A line for each seed."""
    print("seed  solved  frames  wall clock  held out  train   (normalized, fresh episodes)")
    for row in summaries:
        print(f"{row.seed:4d}  {'yes' if row.solved else 'no ':6s}  "
              f"{_figure(row.frames_to_solve, 6)}  {_figure(row.wall_s_to_solve, 8, 0, ' s')}  "
              f"{_figure(row.final_held_out, 8, 2)}  {_figure(row.final_train, 5, 2)}")  # fmt: skip


def _figure(value: float, width: int, digits: int = 0, unit: str = "") -> str:
    """A number with its unit, or a dash where there is none."""
    text = "–" if math.isnan(value) else f"{value:.{digits}f}{unit}"
    return f"{text:>{width + len(unit)}}"


def _study(options: argparse.Namespace, seeds: Sequence[int]) -> int:
    """Evaluate the trained seeds of programmable-3D."""
    from pa_ros.evaluation import results
    from pa_ros.evaluation.agents import load_agent
    from pa_ros.evaluation.seeds import folder_of
    from pa_ros.learning.folder import holds_checkpoint

    chosen = argparse.Namespace(**{**vars(options), "name": "programmable-3D"})
    experiment = _experiment(chosen)
    label = experiment.label
    runs = {seed: folder_of(options.runs / label, seed) for seed in seeds}
    untrained = [seed for seed, run in runs.items() if not holds_checkpoint(run)]
    if untrained:
        raise ConfigError(
            f"experiment {options.name}: expected trained agents in {options.runs / label}, got "
            f"none of seeds {untrained}: first `pa_ros experiment programmable-3D` with the same "
            "options"
        )
    _check_runs(experiment, runs, ended=True)
    if options.cluster is not None:
        _score_on_cluster(options, runs)
    logic = logic_named(options.logic)
    agents = {seed: load_agent(run, logic=logic) for seed, run in runs.items()}
    suffix = label.removeprefix("programmable-3D") + _suffix(logic)
    if options.name == "generalization":
        cache = options.runs / "scores"
        for row in results.generalization(
            agents, options.results, cache, suffix=suffix, conditions=options.conditions
        ):
            print(f"{row.condition:16s} {row.normalized:5.2f} [{row.low:5.2f}, {row.high:5.2f}]  "
                  f"best blind {row.blind_normalized:5.2f}")  # fmt: skip
    elif options.name == "detectors":
        results.detectors(agents, options.results, suffix=suffix)
    else:
        results.equalities(agents, options.results, suffix=suffix)
    return 0


def _suffix(logic: Logic) -> str:
    """Of the names of tables: none for what agents execute by."""
    return "" if logic == MIN_MAX else f".{logic.name}"


def _score_on_cluster(options: argparse.Namespace, runs: dict[int, Path]) -> None:
    """What `generalization` needs, computed on a cluster; the study then reads it."""
    from pa_ros.evaluation.cluster import Cluster, score_on

    if options.name != "generalization":
        raise ConfigError(f"experiment {options.name}: expected no --cluster: it runs here alone")
    with Cluster(options.cluster, options.extension) as cluster:
        score_on(
            cluster,
            runs,
            options.runs / "scores",
            conditions=options.conditions,
            logic=logic_named(options.logic),
        )
