"""Scripts that move the arm, and comparisons of arenas under them."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from pa_ros.arena import ArenaConfig, ReachTask, design_named, scripted_action
from pa_ros.arena.references import Policy, nearest_target, toward
from pa_ros.core.experience import Float64

DESIGN = "2-L"


def clumsy_action(task: ReachTask) -> Float64:
    """Like the script, but aims at the block's center (rad/s, [J])."""
    return toward(task, nearest_target(task))


class AwakeConfig(ArenaConfig):
    """An arena whose blocks never sleep."""

    sleep: ClassVar[bool] = False


def sleep_difference(
    config: ArenaConfig, episodes: int, policy: Policy = scripted_action
) -> tuple[float, int]:
    """Compare an arena without sleeping blocks to one with them, under the script's commands.

    Returns the largest difference of any feature, and the number of rewards that differ.
    """
    awake, asleep = (
        ReachTask(one, design_named(DESIGN), seed=0)
        for one in (AwakeConfig(**config.fields()), config)
    )
    largest, rewards = 0.0, 0
    for episode in range(episodes):
        _, verdict = awake.reset(episode)
        asleep.reset(episode)
        while not verdict.truncated:
            command = policy(awake)
            observation, verdict = awake.step(command)
            compared, other_verdict = asleep.step(command)
            largest = max(largest, float(np.abs(observation.objects - compared.objects).max()))
            rewards += verdict.reward != other_verdict.reward
    return largest, rewards
