"""How fast the arena is, and what the script and random actions score in it."""

from __future__ import annotations

import argparse
from time import perf_counter

import mujoco
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
from pa_ros.core.experience import Float64
from pa_ros.core.text import Report
from pa_ros.world.relation import RELATIONS

DESIGN = "2-L"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--episodes", type=int, default=100, help="of each score (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Speed of each preset, and reward per step by preset and relation."""
    report: dict[str, float] = {}
    for preset, config in PRESETS.items():
        report |= {f"arena.{preset}.{name}": value for name, value in speed(config).items()}
        for relation in RELATIONS:
            design = design_named(DESIGN).with_relations(relation)
            task, name = ReachTask(config, design, seed=0), f"arena.{preset}.{relation}"
            report[f"{name}.script"] = mean_reward(task, scripted_action, options.episodes)
            report[f"{name}.random"] = mean_reward(task, random_policy(0), options.episodes)
    return report


def speed(config: ArenaConfig, steps: int = 5000) -> dict[str, float]:
    """Control steps per second with random commands, resets included.

    `physics_share` is the time of the same commands in MuJoCo alone, divided by the whole.
    """
    task = ReachTask(config, design_named(DESIGN), seed=0)
    rng = np.random.default_rng(0)
    commands = rng.uniform(-1, 1, (steps, config.joints)) * np.array(config.joint_speed_limits)
    _step_all(task, commands[: config.episode_steps])  # builds models, fills caches
    start = perf_counter()
    _step_all(task, commands)
    whole = perf_counter() - start
    return {"steps_per_s": steps / whole, "physics_share": _physics_s(task, commands) / whole}


def _step_all(task: ReachTask, commands: Float64) -> None:
    for i, command in enumerate(commands):
        if i % task.config.episode_steps == 0:
            task.reset(i // task.config.episode_steps)
        task.step(command)


def _physics_s(task: ReachTask, commands: Float64) -> float:
    """Seconds in mj_step for the same commands from the same starts."""
    spent = 0.0
    for i, command in enumerate(commands):
        if i % task.config.episode_steps == 0:
            task.reset(i // task.config.episode_steps)
        task.simulation.data.ctrl[:] = command
        start = perf_counter()
        mujoco.mj_step(task.simulation.model, task.simulation.data, task.config.substeps)
        spent += perf_counter() - start
    return spent
