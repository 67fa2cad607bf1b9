"""Learning meets the real arena: the same rewards either way."""

import pytest

from pa_ros.arena import (
    ReachTask,
    design_named,
    preset_named,
    scripted_action,
    training_programs,
    world_of,
)
from pa_ros.learning.rules.all_goals import AllGoals
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
