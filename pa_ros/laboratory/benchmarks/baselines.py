"""Networks and algorithms of other kinds beside ours, all with our relabeling, on the same task.

Every method learns from the same kind of batches: transitions of its own episodes, relabeled with
training programs, property dropout included. Each keeps the settings of `ours` but for its rates;
`--rates` multiplies them, so that every method can be tuned alike. Scores are shares of episodes
that end satisfied, on layouts of each condition's own.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from laboratory.benchmarks import baseline_networks
from laboratory.benchmarks.samples import whole_episode
from laboratory.studies.tables import read_rows, write_rows
from pa_ros.acting.executing import Actor
from pa_ros.acting.exploration import ExplorationNoise
from pa_ros.arena import (
    Design,
    ReachTask,
    conditions_for,
    design_named,
    play,
    preset_named,
    training_programs,
    world_of,
)
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64, Observation
from pa_ros.core.text import Report
from pa_ros.evaluation.evaluate import EPISODES_SEED, layouts_seed, pursuing
from pa_ros.language import MIN_MAX, PRODUCT, Program, Word
from pa_ros.learning.learner import Learner
from pa_ros.learning.recipes import LearningSettings
from pa_ros.networks.errors import NetworkError

FAMILIES = {"ours": "programmable", "true-properties": "true-properties", "canonical": "canonical"}
OTHERS = ("film-transformer", "deep-sets", "sac")
METHODS = (*FAMILIES, *OTHERS)
WARMUP_FRAMES = 5_000  # before the first update, as in `ours`
WORDS = {f"word-{count}": f"several-{count}" for count in (1, 2, 3)}
"""Conditions of programs that are one word and name so many blocks: drawn from these."""
CONDITIONS = ("train", "eval", *WORDS, "ignore-new", "reach-new-both", "depth-6")

BEST_RATES = {"film-transformer": 0.3}  # of 0.3, 1 and 3, on seed 900; of the other methods: 1

Act = Callable[[Observation, Program], Float32]


@dataclass(frozen=True, slots=True)
class BaselineScore:
    """One method with one seed under one condition; absent if it cannot state the programs."""

    method: str
    design: str
    seed: int
    frames: int
    rates: float  # factor of the learning rates
    seconds: float  # of a processor, for training
    condition: str
    episodes: int
    success: float  # share that end with the program satisfied
    reward: float  # per step


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--design", default="2-L", help="2-L, 3-D, … (%(default)s)")
    parser.add_argument("--preset", default="fast", help="of the arm (%(default)s)")
    parser.add_argument("--seeds", type=int, default=1, help="of each method (%(default)s)")
    parser.add_argument("--first-seed", type=int, default=0, help="(%(default)s)")
    parser.add_argument("--frames", type=int, default=40_000, help="of each run (%(default)s)")
    parser.add_argument("--episodes", type=int, default=100, help="per condition (%(default)s)")
    parser.add_argument("--rates", type=float, help="factor of rates (default: each method's best)")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS, metavar="NAME")
    parser.add_argument(
        "--runs", type=Path, default=Path("runs/baselines"),
        help="folder of the runs' scores; finished runs are not repeated (%(default)s)",
    )  # fmt: skip
    parser.add_argument("--table", type=Path, help="also write the scores of these runs as CSV")


def run(options: argparse.Namespace) -> Report:
    """Train and score the methods; returns means over seeds."""
    scores: list[BaselineScore] = []
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        for method in options.methods:
            rates = BEST_RATES.get(method, 1.0) if options.rates is None else options.rates
            setting = (method, options.design, options.preset, options.frames, options.episodes)
            path = options.runs / f"{'-'.join(map(str, setting))}-{rates:g}-{seed}.csv"
            if not path.exists():
                write_rows(path, scored(method, options, seed, rates))
            rows = read_rows(path, BaselineScore)
            for row in rows:
                print(f"{method}, seed {seed}: {row.condition} {row.success:.0%}", flush=True)
            scores += rows
    if options.table:
        write_rows(options.table, scores)
    return report(scores)


def report(scores: Sequence[BaselineScore]) -> Report:
    """Of each design, method, frames and factor: seeds, mean success and its range over seeds."""
    found: dict[str, float | int | str] = {}
    for row in scores:
        name = f"baselines.{row.design}.{row.method}.{row.frames}.{row.rates:g}.{row.condition}"
        same = ("design", "method", "frames", "rates", "condition")
        group = [one.success for one in scores
                 if all(getattr(one, part) == getattr(row, part) for part in same)]  # fmt: skip
        found |= {f"{name}.seeds": len(group), f"{name}.success": fmean(group),
                  f"{name}.lowest": min(group), f"{name}.highest": max(group)}  # fmt: skip
    return found


def settings_of(method: str, rates: float) -> LearningSettings:
    """`ours`, with a method's networks or algorithm."""
    baseline_networks.register()
    given: dict[str, Any] = {"learner.replay.warmup_frames": WARMUP_FRAMES}
    if method in FAMILIES:
        given["network.family"] = FAMILIES[method]
    settings = LearningSettings(algorithm=method if method in OTHERS else "dpg", **given)
    optimizer = settings.learner.optimizer
    return settings.changed(
        **{
            "learner.optimizer.actor_rate": optimizer.actor_rate * rates,
            "learner.optimizer.critic_rate": optimizer.critic_rate * rates,
        }
    )


def scored(
    method: str, options: argparse.Namespace, seed: int, rates: float
) -> list[BaselineScore]:
    """Train one method with one seed, and score it under each condition that it can state."""
    import torch

    torch.manual_seed(seed)
    torch.set_num_threads(1)
    started = time.process_time()
    learner, act = trained(method, options, seed, rates)
    seconds = time.process_time() - started
    arena, design = preset_named(options.preset), design_named(options.design)
    speeds, rows = np.array(arena.joint_speed_limits), []
    for condition in CONDITIONS:
        if WORDS.get(condition, condition) not in conditions_for(design):
            continue
        if condition in WORDS and not _names_so_many(design, int(condition[-1])):
            continue  # every word of 2-L names two kinds
        task = ReachTask(arena, design, layouts_seed(EPISODES_SEED, condition))
        policy = pursuing(task, lambda seen, program: act(seen, program) * speeds)
        try:
            ends = [_episode(task, policy) for _ in episodes(task, condition, options.episodes)]
        except (ConfigError, NetworkError):
            continue  # the method cannot state such programs
        success, reward = (float(np.mean(column)) for column in zip(*ends, strict=True))
        rows.append(BaselineScore(method, design.name, seed, options.frames, rates, seconds,
                                  condition, len(ends), success, reward))  # fmt: skip
    return rows


def _names_so_many(design: Design, count: int) -> bool:
    """Whether a word is true of at least `count` kinds, and not of all."""
    named = (sum(word in kind.words for kind in design.pool) for word in design.words)
    return any(count <= number < len(design.pool) for number in named)


def episodes(task: ReachTask, condition: str, count: int) -> Iterator[int]:
    """Begin `count` episodes of a condition, one after the other; yields their indices."""
    index = done = 0
    while done < count:
        task.reset(index, WORDS.get(condition, condition))
        index += 1
        if condition not in WORDS or isinstance(task.program.target, Word):
            done += 1
            yield index - 1


def _episode(task: ReachTask, act: Callable[[Observation], Float64]) -> tuple[bool, float]:
    """Play the episode that has begun: is it satisfied at the end, and the reward per step."""
    start = task.set_program(task.program)  # the observation at the start
    _, *verdicts = [verdict for _, verdict in play(task, act, start)]
    return verdicts[-1].satisfied, float(np.mean([verdict.reward for verdict in verdicts]))


def trained(
    method: str, options: argparse.Namespace, seed: int, rates: float
) -> tuple[Learner, Act]:
    """A learner after `frames` frames, and its greedy policy."""
    arena, design = preset_named(options.preset), design_named(options.design)
    settings, world = settings_of(method, rates), world_of(arena, design)
    task, speeds = ReachTask(arena, design, seed), np.array(arena.joint_speed_limits)
    network = settings.network.for_world(world)
    learner = Learner(network, settings.learner, training_programs(design), seed, task.scoring)
    exploration = settings.learner.exploration
    noise = ExplorationNoise(exploration, arena.control_period_s, seed, world.actions)
    actor = None if method in OTHERS else Actor(network, noise=noise, logic=PRODUCT)
    engine: Any = learner.engine

    def behave(seen: Observation, program: Program) -> Float32:
        if method == "sac":
            action: Float32 = engine.sampled(seen, program)
            return action
        if actor is not None:
            return actor.explore(seen, program)
        return noise.explore(engine.greedy(seen, program), seen.episode)

    for episode in range(options.frames // arena.episode_steps):
        if actor is not None:
            actor.load(learner.snapshot())
        actions: list[Float32] = []

        def act(seen: Observation, actions: list[Float32] = actions) -> Float64:
            actions.append(behave(seen, task.program))
            return np.asarray(actions[-1].astype(np.float64) * speeds)

        seen, verdicts = zip(*play(task, act, task.reset(episode)), strict=True)
        rewards = [verdict.reward for verdict in verdicts[1:]]
        objects, arm = [one.objects for one in seen], [world.arm(one) for one in seen]
        made = task.program, objects, arm, actions, rewards, learner.counters.version
        learner.consume(whole_episode(world, episode, *made))
    if actor is None:
        return learner, engine.greedy
    greedy = Actor(network, logic=MIN_MAX)
    greedy.load(learner.snapshot())
    return learner, greedy.act
