"""`pa_ros train`: the same loop as the graph's, in one process."""

from __future__ import annotations

import argparse
import logging
import shlex
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from pa_ros.agents import camera_of, train_agent
from pa_ros.arena import ArenaChoice, training_programs
from pa_ros.bags.run_log import RunLog
from pa_ros.cli import from_bag
from pa_ros.cli.options import add_learning, add_setting, add_settings, learning_from, settings_from
from pa_ros.cli.training_view import TrainingView
from pa_ros.core.errors import ConfigError
from pa_ros.core.signals import EXIT_INTERRUPTED, signals_noted
from pa_ros.learning.config import TrainConfig
from pa_ros.perception import TOLD, VIEWS
from pa_ros.world import reward_from

EXIT_UNRECORDED = 1  # the disk was full; the run itself is whole


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros train`."""
    add_settings(parser, ArenaChoice, "design", "relations", "arm", "preset", "reward")
    parser.add_argument(
        "--perception",
        choices=(TOLD, *VIEWS),
        default=TOLD,
        help="how blocks' properties are known: told, or by cameras above the table, in a corner, "
        "or both (%(default)s)",
    )
    add_setting(parser, TrainConfig, "seed", otherwise="0; with --from-bag, the recorded one")
    add_settings(parser, TrainConfig, "frames", "out")
    parser.add_argument("--resume", action="store_true", help="go on from the checkpoint in OUT")
    parser.add_argument("--record", type=Path, metavar="BAG", help="record the run into a bag")
    parser.add_argument(
        "--from-bag", type=Path, nargs="+", metavar="BAG",
        help="no arena: learn from recorded transitions, with the first bag's settings",
    )  # fmt: skip
    parser.add_argument(
        "--namespace", help="with --from-bag: of the arena, if several were recorded"
    )
    add_setting(parser, TrainConfig, "evaluate_every_frames", "--eval-every")
    add_setting(parser, TrainConfig, "evaluation_episodes", "--eval-episodes")
    add_setting(parser, TrainConfig, "checkpoint_every_frames", "--checkpoint-every")
    add_learning(parser)


def run(options: argparse.Namespace) -> int:
    """Train to `--frames`; rows are shown as they are written to OUT/progress.csv.

    Ctrl-C, or a closed output pipe, ends it after the current episode, with a checkpoint.
    """
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if options.from_bag:
        if options.perception != TOLD:
            raise ConfigError("--perception: expected told with --from-bag, got another")
        return from_bag.run(options)
    if options.namespace is not None:
        raise ConfigError("--namespace: needs --from-bag")
    chosen = settings_from(options, ArenaChoice)
    design, arena = chosen.design_of(), chosen.arena_config()
    learning = learning_from(options, design)
    config = settings_from(options, TrainConfig)
    perception = camera_of(
        config.out if options.resume else None, arena, design, options.perception
    )
    programs, seed = training_programs(design), config.seed
    parameters = {**learning.flat(), "frames": config.frames, "resume": options.resume}
    recorded: AbstractContextManager[RunLog | None] = nullcontext()
    if options.record is not None:
        recorded = RunLog(
            options.record, arena, design, seed, programs, parameters, perception=perception
        )
    with signals_noted() as interrupted, recorded as run_log, TrainingView(config.frames) as view:
        learner = train_agent(
            arena,
            design,
            learning,
            config,
            reward_from(chosen.reward),
            perception=perception,
            resume=options.resume,
            run_log=run_log,
            watcher=view,
            stopped=lambda: interrupted() or view.unread,
        )
    if learner.counters.frames < config.frames:
        print(f"stopped after {learner.counters.frames:,} frames, saved: --resume continues")
        return EXIT_INTERRUPTED
    if learner.counters.frames >= config.frames + arena.episode_steps:
        print(f"there were {learner.counters.frames:,} frames already: nothing was learned")
    from_bag.say_if_untrained(learner)
    given = "".join(f" --extension {shlex.quote(one)}" for one in options.extension or ())
    next_step = f"pa_ros{given} eval --checkpoint {shlex.quote(str(config.out))}"
    print(f"checkpoint and curve in {config.out}; next: {next_step}")
    return EXIT_UNRECORDED if run_log is not None and run_log.failure is not None else 0
