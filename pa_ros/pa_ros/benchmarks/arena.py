"""How fast the arena is: control steps per second and where the time goes."""

from __future__ import annotations

import os
from time import perf_counter

import mujoco
import numpy as np

from pa_ros.arena.config import ArenaConfig, preset_named
from pa_ros.arena.designs import design_named
from pa_ros.arena.task import ReachTask
from pa_ros.core.experience import Float64
from pa_ros.core.software import device, versions


def bench_sim(
    steps: int = 5000, config: ArenaConfig | None = None, design: str = "2-L"
) -> dict[str, float | str]:
    """Time `steps` control steps, resets included, with random commands on one core.

    `sim.physics_share` is the time of the same commands in MuJoCo alone, over the whole.
    """
    arena = config or preset_named("fast")
    task = ReachTask(arena, design_named(design), seed=0)
    rng = np.random.default_rng(0)
    commands = rng.uniform(-1, 1, (steps, arena.joints)) * np.array(arena.joint_speed_limits)
    _run(task, commands[: arena.episode_steps])  # builds models, warms caches
    whole = _run(task, commands)
    return {
        "sim.steps_per_s": steps / whole,
        "sim.physics_share": _physics(task, commands) / whole,
        "sim.observation_us": _observation_us(task),
        "sim.preset": arena.preset,
        "sim.design": design,
        "sim.sleep": str(arena.sleep),
        "device": device(),
        "threads": os.environ.get("OMP_NUM_THREADS", "unset"),
        "versions": versions(),
    }


def _run(task: ReachTask, commands: Float64) -> float:
    start = perf_counter()
    for i, command in enumerate(commands):
        if i % task.config.episode_steps == 0:
            task.reset(i // task.config.episode_steps)
        task.step(command)
    return perf_counter() - start


def _physics(task: ReachTask, commands: Float64) -> float:
    """Seconds in mj_step for the same commands from the same starts."""
    spent = 0.0
    for i, command in enumerate(commands):
        if i % task.config.episode_steps == 0:
            task.reset(i // task.config.episode_steps)
            model, simulated = task.simulation.model, task.simulation.data
        simulated.ctrl[:] = command
        start = perf_counter()
        mujoco.mj_step(model, simulated, task.config.substeps)
        spent += perf_counter() - start
    return spent


def _observation_us(task: ReachTask, repeats: int = 5000) -> float:
    start = perf_counter()
    for _ in range(repeats):
        task.simulation.objects()
    return (perf_counter() - start) / repeats * 1e6
