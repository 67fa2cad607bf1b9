"""How fast the arena is, and what the script and random actions score in it."""

from __future__ import annotations

import argparse
from time import perf_counter

import numpy as np

from pa_ros.arena import (
    PRESETS,
    ArenaConfig,
    ReachTask,
    design_named,
    mean_reward,
    play,
    preset_named,
    random_policy,
    scripted_action,
)
from pa_ros.core.text import Report
from pa_ros.language.syntax import HOLD, ON
from pa_ros.world.relation import RELATIONS

DESIGN = "2-L"
STEPS = 5000  # of one measurement


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--episodes", type=int, default=100, help="of each score (%(default)s)")
    parser.add_argument("--arm", default="", help="default: the preset's own")
    parser.add_argument(
        "--presets", nargs="+", default=list(PRESETS), choices=PRESETS, metavar="NAME"
    )
    parser.add_argument(
        "--design", default=DESIGN, help="one that moves blocks: its success (%(default)s)"
    )


def run(options: argparse.Namespace) -> Report:
    """Speed of each preset, and reward per step by preset and relation, or, of a design that moves
    blocks, the share of episodes that end in success by preset and condition."""
    report: dict[str, float] = {}
    design = design_named(options.design)
    for preset in options.presets:
        config, name = preset_named(preset, options.arm), f"arena.{preset}"
        if design.places:
            task = ReachTask(config, design, seed=0)
            report |= {
                f"{name}.{condition}.success": success(task, condition, options.episodes)
                for condition in ("train", "eval", "pairs")
            }
            continue
        report[f"{name}.steps_per_s"] = speed(config)
        for relation in [one for one in RELATIONS if one not in (HOLD, ON)]:  # of any hand
            task = ReachTask(config, design.with_relations(relation), seed=0)
            for policy, act in ("script", scripted_action), ("random", random_policy(0)):
                report[f"{name}.{relation}.{policy}"] = mean_reward(task, act, options.episodes)
    return report


def success(task: ReachTask, condition: str, episodes: int) -> float:
    """The share of episodes that the script ends in success."""
    ends = []
    for episode in range(episodes):
        start = task.reset(episode, condition)
        *_, (_, end) = play(task, lambda _: scripted_action(task), start)
        ends.append(end.satisfied)
    return float(np.mean(ends))


def speed(config: ArenaConfig) -> float:
    """Control steps per second with random commands, resets included."""
    task = ReachTask(config, design_named(DESIGN), seed=0)
    rng = np.random.default_rng(0)
    limits = np.array(config.command_limits)
    commands = rng.uniform(-1, 1, (STEPS, len(limits))) * limits
    start = perf_counter()
    for i, command in enumerate(commands):
        if i % config.episode_steps == 0:
            task.reset(i // config.episode_steps)
        task.step(command)
    return STEPS / (perf_counter() - start)
