"""Sleeping of resting blocks changes nothing but the speed."""

import numpy as np
import pytest

from helpers.scripts import AwakeConfig, sleep_difference
from pa_ros.arena import ArenaConfig, Design, Kind, ReachTask, design_named, preset_named
from pa_ros.arena.appearance import RESTING_DEPTH_M
from pa_ros.language import Vocabulary

SHAPES = tuple(RESTING_DEPTH_M)


@pytest.mark.parametrize("preset", ["paper", "fast"])
def test_features_and_rewards_are_the_same_awake(preset: str) -> None:
    difference, rewards = sleep_difference(preset_named(preset), 8)
    assert difference < 2e-5
    assert rewards == 0


def test_all_blocks_sleep_until_touched() -> None:
    task = ReachTask(preset_named("fast"), design_named("2-L"), 0)
    task.reset(0)
    for _ in range(20):
        task.step(np.full(6, 0.5))
    np.testing.assert_array_equal(task.simulation.data.tree_awake, [1, 0, 0, 0, 0])


@pytest.mark.parametrize("config", [preset_named("paper")])
def test_awake_blocks_rest_where_sleeping_ones_lie(config: ArenaConfig) -> None:
    """The resting depths in the constants are MuJoCo's own."""
    values = {"shape": SHAPES, "color": ("RED",)}
    target = Kind(color="RED", shape="CUBE")
    design = Design("all", values, Vocabulary.of(**values), (target,))
    task = ReachTask(AwakeConfig(**config.fields()), design, 0)
    task.reset(0)
    start = task.simulation.positions
    for _ in range(50):
        task.step(np.zeros(6))
        np.testing.assert_allclose(task.simulation.positions[1:], start[1:], atol=5e-5)
