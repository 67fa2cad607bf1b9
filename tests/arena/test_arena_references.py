"""The scripted and random references, pictures, and the benchmark."""

import math

import numpy as np
import pytest

from pa_ros.arena import (
    ReachTask,
    RenderError,
    conditions_for,
    design_named,
    mean_reward,
    preset_named,
    random_policy,
    scripted_action,
)
from pa_ros.arena.references import reward_per_step
from pa_ros.arena.render import render


@pytest.mark.parametrize("preset", ["paper", "fast"])
@pytest.mark.parametrize("condition", conditions_for(design_named("3-D")))
def test_the_script_reaches_the_target_under_every_condition(preset: str, condition: str) -> None:
    task = ReachTask(preset_named(preset), design_named("3-D"), seed=2)
    for episode in range(5):
        assert reward_per_step(task, scripted_action, episode, condition) > -0.2
        observation = task.simulation.objects()
        assert task.verifier.score(observation, task.simulation.hand_pose).measure < 0.20


def test_script_stays_within_the_limits() -> None:
    task = ReachTask(preset_named("paper"), design_named("2-L"), seed=0)
    limits = np.array(task.config.joint_speed_limits)
    for episode in range(5):
        _, verdict = task.reset(episode)
        while not verdict.truncated:
            command = scripted_action(task)
            assert command.shape == (6,) and (np.abs(command) <= limits).all()
            _, verdict = task.step(command)


def test_random_policy_is_uniform_seeded_and_poor() -> None:
    task = ReachTask(preset_named("fast"), design_named("2-L"), seed=0)
    task.reset(0)
    policy, again = random_policy(3), random_policy(3)
    drawn = np.array([policy(task) for _ in range(2000)])
    np.testing.assert_array_equal(drawn[:5], [again(task) for _ in range(5)])
    assert np.abs(drawn).max() <= 1.5
    np.testing.assert_allclose(drawn.std(axis=0), 1.5 / math.sqrt(3), rtol=0.05)
    assert mean_reward(task, random_policy(0), 20) < -0.8


def test_rendering_gives_a_picture_or_says_what_is_missing() -> None:
    task = ReachTask(preset_named("fast"), design_named("2-L"), seed=0)
    task.reset(0)
    for _ in range(2):  # without OpenGL, MuJoCo aborts the process at a second attempt
        try:
            picture = render(task.simulation, 160, 120)
        except RenderError as refusal:
            assert "OpenGL" in str(refusal)
        else:
            assert picture.shape == (120, 160, 3) and picture.std() > 5
