"""Learning to stack: places under where blocks came to rest, and taking before putting."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.worlds import random_trajectory
from pa_ros.arena import (
    ReachTask,
    design_named,
    play,
    preset_for,
    scripted_action,
    training_programs,
)
from pa_ros.language import roles
from pa_ros.learning.config import HindsightConfig
from pa_ros.learning.replay_buffer.buffer import ReplayBuffer
from pa_ros.learning.rules.hindsight import Hindsight
from pa_ros.world import Trajectory
from pa_ros.world.poses import in_base
from pa_ros.world.relation import BLOCK_M

STACK = design_named("stack-2")
PROGRAMS = training_programs(STACK)


@pytest.fixture(scope="module")
def task() -> ReachTask:
    return ReachTask(preset_for(STACK), STACK, seed=1)


def built(task: ReachTask, index: int) -> Trajectory:
    """An episode in which the script puts a block on another one."""
    seen = [
        one
        for one, _ in play(task, lambda _: scripted_action(task), task.reset(index, "pairs-train"))
    ]
    fields = {
        "objects": np.stack([one.objects for one in seen]),
        "arm": np.stack([task.world.arm(one) for one in seen]),
        "world_digest": task.world.digest,
        "program": task.program,
        "actions": np.zeros((len(seen) - 1, task.world.actions), np.float32),
    }
    return random_trajectory(np.random.default_rng(index), len(seen) - 1, sequence=index, **fields)


def test_a_place_goes_under_where_a_block_came_to_rest_at_any_height(task: ReachTask) -> None:
    scoring = task.scoring
    rule = Hindsight(
        PROGRAMS, task.world, scoring, HindsightConfig(moved=1, future=1, cross=0, either=0)
    )
    replay = ReplayBuffer(1000, task.world, columns=rule.columns)
    ends = []
    for index in range(4):
        trajectory = built(task, index)
        replay.insert(trajectory, 0, rule.describe(trajectory))
        positions = in_base(
            task.world.hand_pose(trajectory.arm[-1]).astype(float),
            trajectory.objects[-1, :, :7].astype(float),
        )
        ends.append(positions[1:, 2].max())
    assert max(ends) == pytest.approx(1.5 * BLOCK_M, abs=2e-3)  # one on another
    drawn = rule.draw(np.random.default_rng(0), replay, 600)
    hands = task.world.hand_pose(drawn.arm).astype(float)
    heights = in_base(hands[:, None], drawn.objects[..., :7].astype(float))[..., 2]
    names = [str(PROGRAMS[row]) for row in drawn.program[:, 0]]
    to_place = np.array(["PLACE" in name for name in names])
    places = heights[:, 4:][to_place]
    # Under a block on the table, or under one that is on another.
    assert (np.abs(places - BLOCK_M / 2) < 2e-3).any() and (places < -BLOCK_M / 2 + 2e-3).any()
    rewards = drawn.reward[:, 0]
    for row in range(200):
        program = PROGRAMS[drawn.program[row, 0]]
        words = [kind.split() for kind in STACK.schema.labels(drawn.objects[row], 0)]
        sets = [np.flatnonzero(one).tolist() for one in roles(program, words, 0, ("PLACE",))]
        hand = task.world.hand_pose(drawn.next_arm[row])
        assert (
            rewards[row] == scoring.of_program(program, sets, drawn.next_objects[row], hand).reward
        )
    assert 0.05 < (rewards[to_place] == 1.0).mean() < 0.95


def test_the_networks_see_whether_the_hand_holds_something(task: ReachTask) -> None:
    world = task.world
    observation, _ = task.reset(0, "train")
    assert world.actions == 4 and world.commands == 7 and world.hand_features == 8
    assert world.arm_features == 18 + 8 == len(world.arm(observation))
    held = replace(observation, hand_pose=np.append(observation.hand_pose[:7], 1.0))
    changed = np.flatnonzero(world.arm(held) != world.arm(observation))
    assert changed.tolist() == ([] if observation.hand_pose[7] else [25])
