"""What an update costs where programs move objects, beside the same update without roles.

Both have the networks of the protocol `push`, the same batch size and scenes of as many objects.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.learner import engine_of, repeated
from benchmarks.samples import played, whole_episode
from benchmarks.timing import Contender, measure
from pa_ros.arena import (
    ReachTask,
    design_named,
    preset_named,
    scripted_action,
    training_programs,
    world_of,
)
from pa_ros.core.text import Report
from pa_ros.language import Program
from pa_ros.learning.learner import Learner
from pa_ros.learning.protocols import PUSH, LearningSettings
from pa_ros.native import library as fused_library
from pa_ros.world import Trajectory
from pa_ros.world.world import World

DESIGN, EPISODES = "push-2", 20
DRAWN = 100  # batches at once: those of an episode, as in learning
WITH, WITHOUT = "roles.updates_per_s", "roles.updates_without_per_s"
DRAW, DRAW_WITHOUT = "roles.hundred_draws_per_s", "roles.hundred_draws_without_per_s"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--batch", type=int, default=64, help="transitions (%(default)s)")
    parser.add_argument("--rounds", type=int, default=15, help="of all contenders (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Updates of the fused engine with and without roles, and what drawing a batch costs."""
    design = design_named(DESIGN)
    task = ReachTask(preset_named(design.preset), design, seed=0)
    world, programs = world_of(task.config, design), training_programs(design)
    # The same objects and words for programs that move the hand alone: no roles, and no pose of the
    # hand, which ends the arm's features.
    plain = replace(world, vocabulary=replace(world.vocabulary, moves_objects=False, bodiless=()))
    trajectories = [_episode(task, world, i) for i in range(EPISODES)]
    moving = _learner(world, programs, trajectories, options.batch)
    reaching = [program for program in programs if program.moves_hand]
    still = [
        replace(
            t,
            arm=t.arm[:, : plain.arm_features],
            program=reaching[0],
            world_digest=plain.digest,
        )
        for t in trajectories
    ]
    contenders = []
    without = _learner(plain, reaching, still, options.batch)
    for learner, update, draw in ((moving, WITH, DRAW), (without, WITHOUT, DRAW_WITHOUT)):
        engine = engine_of(learner, name="fused", threads=1)
        contenders.append(Contender(update, repeated(engine.update, list(learner.batches(16)))))
        contenders.append(Contender(draw, partial(_draw, learner)))
    measure(contenders, options.rounds, 0.25)
    report: dict[str, Any] = {
        "roles.batch": options.batch,
        "roles.objects": trajectories[0].objects.shape[1],
        "roles.instructions": fused_library.level(),
    }
    for one in contenders:
        report |= {one.name: one.rate, f"{one.name}_spread": one.spread}
    return report | {
        "roles.ratio": report[WITHOUT] / report[WITH],
        "roles.draw_share": report[WITH] / report[DRAW] / DRAWN,
        "roles.draw_share_without": report[WITHOUT] / report[DRAW_WITHOUT] / DRAWN,
    }


def _draw(learner: Learner, calls: int) -> None:
    for _ in range(calls):
        for _ in learner.batches(DRAWN):
            pass


def _learner(
    world: World, programs: Sequence[Program], trajectories: Sequence[Trajectory], batch: int
) -> Learner:
    settings = LearningSettings(protocol=PUSH)
    frames = sum(len(t.actions) for t in trajectories)
    config = settings.learner.changed(
        **{"replay.batch_size": batch, "replay.warmup_frames": frames}
    )
    learner = Learner(settings.network.for_world(world), config, programs, seed=0)
    for trajectory in trajectories:
        learner.consume(trajectory)
    return learner


def _episode(task: ReachTask, world: World, number: int) -> Trajectory:
    """An episode in which the script pushes a block; its actions are any."""
    seen, rewards = played(task, number, lambda _: scripted_action(task))
    actions = np.random.default_rng(number).uniform(-1, 1, (len(rewards), world.actions))
    objects, arm = [one.objects for one in seen], [world.arm(one) for one in seen]
    return whole_episode(world, number, task.program, objects, arm, actions, rewards)
