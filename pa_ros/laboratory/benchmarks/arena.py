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


def run(options: argparse.Namespace) -> Report:
    """Speed of each preset, and reward per step by preset and relation."""
    report: dict[str, float] = {}
    for preset, config in PRESETS.items():
        report[f"arena.{preset}.steps_per_s"] = speed(config)
        for relation in [one for one in RELATIONS if one not in (HOLD, ON)]:  # of any hand
            design = design_named(DESIGN).with_relations(relation)
            task, name = ReachTask(config, design, seed=0), f"arena.{preset}.{relation}"
            report[f"{name}.script"] = mean_reward(task, scripted_action, options.episodes)
            report[f"{name}.random"] = mean_reward(task, random_policy(0), options.episodes)
    return report


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
