"""`pa_ros train --from-bag`: offline updates from recorded transitions."""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from pa_ros.arena import ArenaChoice, training_programs, world_of
from pa_ros.bags.errors import ProvenanceError
from pa_ros.bags.experience import Experience, OfflineResult, learn
from pa_ros.bags.reader import Bag
from pa_ros.cli.options import asked, learning_from, learning_given, settings_from
from pa_ros.core.errors import ConfigError
from pa_ros.core.settings import nested
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.checkpoints import save_checkpoint
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.folder import checkpoint_of, claim
from pa_ros.learning.learner import Learner
from pa_ros.learning.recipes import LearningSettings
from pa_ros.networks.config import NetworkConfig
from pa_ros.wire import WireError
from pa_ros.wire.learning import weights_checksum
from pa_ros.world import Scoring, reward_from

log = logging.getLogger(__name__)
REPORT_S = 5.0
EXIT_INCOMPLETE = 1


def run(options: argparse.Namespace) -> int:
    """Learn from the bags in order, with the settings of the first, and save a checkpoint."""
    if options.resume or options.record:
        raise ConfigError("--from-bag: cannot be used with --resume or --record")
    if unused := {*asked(options, TrainConfig)} - {"seed", "out"}:
        raise ConfigError(f"--from-bag: expected no {', '.join(sorted(unused))}: all that was "
                          "recorded is learned from, without evaluation")  # fmt: skip
    with ExitStack() as stack:
        opened = [stack.enter_context(Bag(path)) for path in options.from_bag]
        bags = [Experience.read(bag, options.namespace) for bag in opened]
        learner, about = _learner(options, bags[0])
        for path, bag in zip(options.from_bag, bags, strict=True):
            _check_world(path, bag, learner)
        stack.enter_context(claim(options.out))  # last, so that a rejected bag leaves no folder
        started = time.monotonic()
        logged = started

        def report(_: OfflineResult) -> None:
            nonlocal logged
            if time.monotonic() - logged >= REPORT_S:
                logged = time.monotonic()
                counters = learner.counters
                log.info("frames %d  updates %d", counters.frames, counters.updates)

        found = learn(bags, learner, report)
        extra = {"wall_s": time.monotonic() - started, **about}
        save_checkpoint(checkpoint_of(options.out), learner, extra)
    _conclude(found, learner, options.out)
    return 0 if found.complete else EXIT_INCOMPLETE


def say_if_untrained(learner: Learner) -> None:
    """Print why the weights are still the initial ones, if no update was made."""
    if not learner.counters.updates:
        warmup = learner.config.replay.warmup_frames
        print(
            f"no update was made: the first one needs more than {warmup:,} frames "
            "(--learner.replay.warmup_frames)"
        )


def _learner(options: argparse.Namespace, bag: Experience) -> tuple[Learner, dict[str, object]]:
    """A new learner with the recorded settings, and facts of the run for its checkpoint."""
    try:
        origin = bag.learner
    except ProvenanceError as error:
        log.warning("%s; learning with --design, --recipe and --seed", error)
        return _learner_asked(options)
    assert origin.learner is not None
    network = NetworkConfig.from_json(origin.learner.network)
    algorithm = origin.learner.algorithm
    config = ALGORITHMS[algorithm].config.from_json(origin.learner.learner)
    recorded = {
        "design": origin.design,
        "relations": network.world.relations,
        "arm": origin.arm,
        "preset": origin.preset,
        # Older bags call it protocol.
        "recipe": str(origin.parameters.get("recipe", origin.parameters.get("protocol", ""))),
        "algorithm": algorithm,
        "network.family": network.family,
        "reward": bag.scoring.reward.to_json(),
    }
    _check_recorded(options, recorded)
    changes = nested(learning_given(options, LearningSettings(algorithm=algorithm)))
    network = network.changed(**changes.get("network", {}))
    config = config.changed(**changes.get("learner", {}))
    seed = origin.seed if options.seed is None else options.seed
    programs = origin.learner.training_programs
    learner = Learner(network, config, programs, seed, bag.scoring)
    return learner, {
        "seed": seed,
        "design": origin.design,
        "preset": origin.preset,
        "arm": origin.arm,
        "perception": next((arena.perception for arena in bag.arenas), ""),
    }


def _check_world(path: Path, bag: Experience, learner: Learner) -> None:
    """Raise ConfigError if the bag's first trajectory is from another world."""
    try:
        # Decoding one trajectory shows whether the worlds differ; nothing is learned from it here.
        next(bag.used(learner.network.world), None)
    except WireError as error:
        if error.code != "wire.world":
            raise
        raise ConfigError(
            f"bag: {path}: expected a recording of the learner's world: {error}"
        ) from error


def _learner_asked(options: argparse.Namespace) -> tuple[Learner, dict[str, object]]:
    chosen = settings_from(options, ArenaChoice)
    design, arena = chosen.design_of(), chosen.arena_config()
    learning = learning_from(options, design)
    seed = options.seed or 0
    learner = Learner(
        learning.network.for_world(world_of(arena, design)),
        learning.learner,
        training_programs(design),
        seed,
        Scoring.of(design.vocabulary.relations, arena.thresholds, reward_from(options.reward)),
    )
    about = {"design": design.name, "preset": arena.preset, "arm": arena.arm}
    return learner, {"seed": seed, **about}


def _check_recorded(options: argparse.Namespace, recorded: Mapping[str, object]) -> None:
    """Raise ConfigError if an option was given that differs from the recording."""
    kinds = (ArenaChoice, LearningSettings, TrainConfig)
    given = {name: getattr(options, name) for kind in kinds for name in asked(options, kind)}
    if family := getattr(options, "network.family", None):
        given["network.family"] = family
    if "relations" in given:
        given["relations"] = tuple(given["relations"])
    if "reward" in given:
        given["reward"] = reward_from(given["reward"]).to_json()
    for name, value in recorded.items():
        if given.get(name, value) != value:
            raise ConfigError(
                f"--from-bag: expected the recording's {name} {value}, got {given[name]}; only "
                "--seed and settings such as --learner.updates.per_frame may differ"
            )


def _conclude(found: OfflineResult, learner: Learner, out: Path) -> None:
    counters = learner.counters
    print(
        f"{found.accepted} trajectories, {counters.frames} transitions, {counters.updates} updates"
        f"; checkpoint in {out / 'checkpoint'}"
    )
    for count, what in (
        (found.missing, "trajectories were learned from but are not in the bag"),
        (found.left_out, "trajectories in the bag were not learned from when it was recorded"),
        (
            found.unordered,
            "versions were made before the recording, by several agents. The order of their "
            "trajectories is unknown, so the weights differ",
        ),
    ):
        if count:
            print(f"{count} {what}")
    say_if_untrained(learner)
    print(f"weights of version {counters.version}: {weights_checksum(learner.snapshot())}")
