"""Learning meets the real arena: the same rewards either way, and the loop runs on it."""

import numpy as np
import pytest

from helpers.worlds import dpg
from pa_ros.arena import (
    ReachTask,
    design_named,
    preset_named,
    scripted_action,
    training_programs,
    world_of,
)
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.loop import train
from pa_ros.learning.rules.all_goals import AllGoals
from pa_ros.networks.config import NetworkConfig
from pa_ros.world import Scoring


@pytest.mark.parametrize("design_name", ["2-L", "3-D"])
def test_relabeled_rewards_are_the_verifiers(design_name) -> None:
    """Each training program is set in turn at every step of scripted episodes."""
    design, arena = design_named(design_name), preset_named("fast")
    programs = training_programs(design)
    relabeler = AllGoals(programs, world_of(arena, design), Scoring())
    task = ReachTask(arena, design, seed=1)
    seen = set()
    for episode in range(3):
        observation, _ = task.reset(episode)
        _, present, *_ = relabeler.masks(observation.objects[None], observation.hand_index)
        named = [j for j in range(len(programs)) if present >> j & 1]
        for t in range(40):
            own = task.program
            satisfied, *_ = relabeler.masks(observation.objects[None], observation.hand_index)
            for j in named:
                _, verdict = task.set_program(programs[j])
                assert verdict.satisfied == bool(int(satisfied[0]) >> j & 1), (episode, t, j)
                seen.add(verdict.satisfied)
            task.set_program(own)
            observation, _ = task.step(scripted_action(task))
    assert seen == {True, False}


def test_the_loop_runs_on_the_arena(tmp_path) -> None:
    design, arena = design_named("2-L"), preset_named("fast")
    network = NetworkConfig(world=world_of(arena, design), hidden=8, attention=4)
    settings = dpg(
        replay__batch_size=4,
        replay__warmup_frames=100,
        relabeling__rule="all-goals",
        schedule__policy_lag=0,
    )
    learner = train(
        TrainConfig(out=tmp_path, seed=2, frames=300, evaluate_every_frames=100),
        network,
        settings,
        ReachTask(arena, design, seed=2),
        np.array(arena.joint_speed_limits),
        training_programs(design),
        evaluate=lambda actor: {"version": float(actor.version)},
    )
    counters = learner.counters
    assert (counters.frames, counters.episodes, counters.updates) == (300, 3, 200)
    assert learner.replay.rows == 303
    assert set(learner.table.programs) == set(training_programs(design))
    rows = (tmp_path / "progress.csv").read_text().splitlines()
    assert [row.split(",")[-1] for row in rows] == ["version", "1.0", "2.0", "3.0"]
