"""What the presets were chosen by: the tables of docs/arena.md.

`python -m pa_ros.benchmarks.arena_measure [--episodes N]`
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from itertools import product

import numpy as np

from pa_ros.arena.arms import ARMS
from pa_ros.arena.config import PRESETS, ArenaConfig, preset_named
from pa_ros.arena.designs import DESIGNS, design_named
from pa_ros.arena.references import (
    Policy,
    mean_reward,
    nearest_target,
    random_policy,
    reward_per_step,
    scripted_action,
    toward,
)
from pa_ros.arena.task import ReachTask
from pa_ros.benchmarks.arena import bench_sim
from pa_ros.core.experience import Float64

DESIGN = "2-L"
NUDGE_RAD = 1e-7  # at the hand, 0.04 µm


def references(episodes: int) -> Iterable[str]:
    """Both references on every arm, preset and design."""
    yield "| arm | preset | design | random | scripted |\n|---|---|---|---|---|"
    settings = [preset_named(preset, arm) for arm in ARMS for preset in PRESETS]
    for config, design in product(settings, map(design_named, DESIGNS)):
        task = ReachTask(config, design, seed=0)
        low = mean_reward(task, random_policy(0), episodes)
        high = mean_reward(task, scripted_action, episodes)
        yield f"| {config.arm} | {config.preset} | {design.name} | {low:.3f} | {high:.3f} |"


def speeds_and_thresholds(episodes: int) -> Iterable[str]:
    """Scripted reward per step by joint speed and threshold, without and with contact."""
    yield "| rad/s | 0.10 m | 0.15 m | 0.20 m | 0.20 m, arm touches blocks |\n|---|---|---|---|---|"
    for speed in (0.4, 0.5, 0.628, 1.0, 1.5):
        fast = PRESETS["fast"]
        free = fast.changed(preset="custom", joint_speed_limits=(speed,) * fast.joints)
        row = [free.changed(thresholds=(threshold,)) for threshold in (0.10, 0.15, 0.20)]
        row.append(free.changed(arm_touches_blocks=True))
        yield f"| {speed} | " + " | ".join(f"{_scripted(c, episodes):.3f}" for c in row) + " |"


def contact(episodes: int) -> Iterable[str]:
    """Contact's cost for the script, and for one that aims at the block's center."""
    yield (
        "| blocks | script | script that aims at the center | blocks moved > 3 cm by it |\n"
        "|---|---|---|---|"
    )
    paper = PRESETS["paper"]
    rows = {"not touched": paper.changed(arm_touches_blocks=False)}
    for mass, friction in ((0.1, 1.0), (0.5, 1.0), (1.0, 0.5), (1.0, 1.0), (2.0, 1.0)):
        rows[f"{mass} kg, friction {friction}"] = paper.changed(
            block_mass_kg=mass, block_friction=friction
        )
    for name, config in rows.items():
        reward, moved = _clumsy(config, episodes)
        yield f"| {name} | {_scripted(config, episodes):.3f} | {reward:.3f} | {moved:.2f} |"


def sleeping(episodes: int) -> Iterable[str]:
    """What sleeping changes, beside what a nudge of the base by 1e-7 rad changes without it."""
    yield (
        "| preset | script | largest difference of any feature | rewards that differ "
        "| rewards that differ by the nudge | rewards |\n|---|---|---|---|---|---|"
    )
    for preset, config in PRESETS.items():
        for script, policy in (("hovers", scripted_action), ("pushes the block", clumsy_action)):
            difference, rewards = sleep_difference(config, episodes, policy)
            _, nudged = sleep_difference(config, episodes, policy, nudge_rad=NUDGE_RAD)
            yield (
                f"| {preset} | {script} | {difference:.1e} | {rewards} | {nudged} "
                f"| {episodes * config.episode_steps} |"
            )
    yield "\n| preset | steps/s, sleeping | steps/s, awake |\n|---|---|---|"
    for preset, config in PRESETS.items():
        asleep, awake = (
            bench_sim(5000, config.changed(sleep=sleep))["sim.steps_per_s"]
            for sleep in (True, False)
        )
        yield f"| {preset} | {asleep:.0f} | {awake:.0f} |"


def sleep_difference(
    config: ArenaConfig, episodes: int, policy: Policy = scripted_action, nudge_rad: float = 0.0
) -> tuple[float, int]:
    """Compare an arena without sleeping to one with it, under the script's commands.

    Returns the largest difference of any feature of Ω, and how many rewards differ. With a
    nudge, neither sleeps, and the second one's base starts turned by it.
    """
    awake = ReachTask(config.changed(sleep=False), design_named(DESIGN), seed=0)
    other = ReachTask(config.changed(sleep=nudge_rad == 0.0), design_named(DESIGN), seed=0)
    largest, rewards = 0.0, 0
    for episode in range(episodes):
        _, verdict = awake.reset(episode)
        other.reset(episode)
        other.simulation.data.qpos[0] += nudge_rad
        while not verdict.truncated:
            command = policy(awake)
            observation, verdict = awake.step(command)
            compared, other_verdict = other.step(command)
            largest = max(largest, float(np.abs(observation.objects - compared.objects).max()))
            rewards += verdict.reward != other_verdict.reward
    return largest, rewards


def time_steps(episodes: int) -> Iterable[str]:
    """Physics step: speed, hand's distance from where 1 ms steps take it, velocity's error."""
    yield (
        "| step, ms | steps/s | hand apart after 1 s, mm | velocity's error after 0.1 s, rad/s |\n"
        "|---|---|---|---|"
    )
    exact = PRESETS["fast"].changed(timestep_s=0.001)
    for milliseconds in (1, 2, 5, 10, 20):
        config = PRESETS["fast"].changed(timestep_s=milliseconds / 1000)
        apart, error = _compare(exact, config, episodes)
        rate = bench_sim(2000, config)["sim.steps_per_s"]
        yield f"| {milliseconds} | {rate:.0f} | {1000 * apart:.2f} | {error:.3f} |"


def speed(episodes: int) -> Iterable[str]:
    """Control steps per second, share of the physics, observation's cost."""
    yield "| preset | steps/s | share of mj_step | observation, µs |\n|---|---|---|---|"
    for preset, config in PRESETS.items():
        rate, share, cost = (
            bench_sim(100 * episodes, config)[f"sim.{name}"]
            for name in ("steps_per_s", "physics_share", "observation_us")
        )
        yield f"| {preset} | {rate:.0f} | {share:.2f} | {cost:.1f} |"


def clumsy_action(task: ReachTask) -> Float64:
    """Like the script, but aims at the block's center (rad/s, [J])."""
    return toward(task, nearest_target(task))


def _scripted(config: ArenaConfig, episodes: int) -> float:
    return mean_reward(ReachTask(config, design_named(DESIGN), seed=0), scripted_action, episodes)


def _clumsy(config: ArenaConfig, episodes: int) -> tuple[float, float]:
    task = ReachTask(config, design_named(DESIGN), seed=0)
    rewards, moved = [], []
    for episode in range(episodes):
        task.reset(episode)
        before = task.simulation.positions
        rewards.append(reward_per_step(task, clumsy_action, episode))
        shift = np.linalg.norm((task.simulation.positions - before)[1:, :2], axis=1)
        moved.append(shift > 0.03)
    return float(np.mean(rewards)), float(np.mean(moved))


def _compare(exact: ArenaConfig, config: ArenaConfig, episodes: int) -> tuple[float, float]:
    """Hand's distance (m) after 1 s there and back; joints' error (rad/s) after the first 0.1 s.

    Shoulder and elbow are left out of the error: they meet their limits.
    """
    tasks = [ReachTask(c, design_named(DESIGN), seed=0) for c in (exact, config)]
    rng = np.random.default_rng(0)
    free = [0, 3, 4, 5]
    apart, errors = [], []
    for episode in range(episodes):
        for task in tasks:
            task.reset(episode)
        command = np.array(config.joint_speed_limits) * rng.choice([-1.0, 1.0], config.joints)
        command *= rng.uniform(0.2, 1.0, config.joints)
        for step in range(10):
            for task in tasks:
                task.step(command if step < 5 else -command)
            if step == 0:
                reached = tasks[1].simulation.joint_velocity
                errors.append(np.abs(reached - command)[free].mean())
        hands = [task.simulation.positions[0] for task in tasks]
        apart.append(np.linalg.norm(hands[0] - hands[1]))
    return float(np.mean(apart)), float(np.mean(errors))


def main() -> None:
    """Print every table, each with its title."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=100)
    episodes = parser.parse_args().episodes
    for table in (references, speeds_and_thresholds, contact, sleeping, time_steps, speed):
        print(f"\n{table.__doc__}\n", *table(episodes), sep="\n", flush=True)


if __name__ == "__main__":
    main()
