"""The scripted and random reference policies."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from pa_ros.arena import (
    ReachTask,
    conditions_for,
    design_named,
    mean_reward,
    preset_named,
    random_policy,
    scripted_action,
)
from pa_ros.arena.references import nearest_target, reward_per_step, toward
from pa_ros.language import parse


@pytest.mark.parametrize("preset", ["paper", "fast"])
def test_the_script_reaches_the_target_under_every_condition(preset: str) -> None:
    task = ReachTask(preset_named(preset), design_named("3-D"), seed=2)
    for condition, episode in product(conditions_for(task.design), range(2)):
        reward = reward_per_step(task, scripted_action, episode, condition)
        score = task.verifier.score(task.simulation.objects(), task.simulation.hand_pose)
        assert reward > -0.2 and score.measure < 0.20, condition


@pytest.mark.parametrize(
    ("design", "arm", "condition", "reached", "speed"),
    [
        ("3-D-relations", "jaco", "train", [8, 1, 15, 5, 9, 2, 2, 8, 5, 2], 0.11602),
        ("3-D-relations", "panda", "train", [8, 2, 2, 2, 3, 1], 0.09078),
        ("3-D-avoid", "jaco", "avoid", [4, 10, 7, 10], 0.12746),
        ("sizes", "jaco", "compare-size-8", [14, 11, 10, 2], 0.16297),
        ("push-2", "jaco", "eval", [59, 42, 49, 40], 0.26199),
        ("push-2", "panda", "pairs", [38, 26, 22, 40], 0.19909),
        ("push-2 LEFT_OF BEHIND", "jaco", "pairs", [51, math.nan, 61, 56], 0.34048),
    ],
)
def test_the_script_never_changes(design, arm, condition, reached, speed) -> None:
    """Published scores are shares of its own: when it arrives, and its mean speed in rad/s.

    Blocks that are pushed multiply the last bits, in which processors differ.
    """
    name, *relations = design.split()
    pushes = name == "push-2"
    of = design_named(name).with_relations(*relations) if relations else design_named(name)
    task, speeds, found = ReachTask(preset_named(of.preset, arm), of, seed=2), [], []
    for episode in range(len(reached)):
        task.reset(episode, condition)
        holds = []
        for _ in range(70 if pushes else 40):
            action = scripted_action(task)
            speeds.append(np.abs(action).mean())
            holds.append(task.step(action)[1].satisfied)
        found.append(1 + holds.index(True) if any(holds) else math.nan)
    assert found == pytest.approx(reached, abs=1 if pushes else 0, nan_ok=True)
    assert np.mean(speeds) == pytest.approx(speed, rel=0.1 if pushes else 1e-3)


@pytest.mark.parametrize(
    ("base", "goal", "turns"),
    [
        (100, -100, "back"),  # 160° forward would pass the limit: the other way round
        (-100, 100, "forward"),
        (100, 20, "back"),
        (10, 80, "forward"),
        (-90, -20, "forward"),
    ],
)
def test_a_base_with_limits_turns_the_way_that_it_can(base: int, goal: int, turns: str) -> None:
    """Angles in degrees; the Panda's base turns from -103° to 103°."""
    task = ReachTask(preset_named("fast", "panda"), design_named("2-L"), seed=0)
    task.reset(0)
    start = math.radians(base), *task.episode.arm_start[1:]
    task.reset_to(replace(task.episode, arm_start=start))
    place = [0.4 * math.cos(math.radians(goal)), 0.4 * math.sin(math.radians(goal)), 0.2]
    speed = toward(task, np.array(place))[0]
    assert speed == (1.0 if turns == "forward" else -1.0) * task.config.joint_speed_limits[0]


def test_the_script_goes_to_the_nearest_of_several_targets() -> None:
    task = ReachTask(preset_named("fast"), design_named("2-L"), seed=0)
    for episode in range(5):
        task.reset(episode)
        task.set_program(parse("NEAR(HAND, OR(RED, BLUE))", task.design.vocabulary))
        hand, *blocks = task.simulation.positions
        distances = [math.dist(block, hand) for block in blocks]
        assert math.dist(nearest_target(task), hand) == min(distances) < max(distances)


@pytest.mark.parametrize("arm", ["jaco", "panda"])
@pytest.mark.parametrize("way", [-0.01, 0.01])
def test_the_script_reaches_a_place_beside_the_hand_in_one_period(arm: str, way: float) -> None:
    task = ReachTask(preset_named("fast", arm), design_named("2-L"), seed=0)
    task.reset(0)
    simulation, offset = task.simulation, np.array([0.0, 0.0, way])
    speeds = toward(task, simulation.positions[0] + offset)
    moved = simulation.hand_jacobian() @ speeds * task.config.control_period_s
    np.testing.assert_allclose(moved, offset, atol=0.001)


def test_the_score_of_an_episode_is_the_mean_over_its_steps() -> None:
    task = ReachTask(preset_named("fast"), design_named("2-L"), seed=0)
    assert reward_per_step(task, lambda _: np.zeros(6), 0) == -1.0  # it starts near no block


def test_random_policy_is_uniform_seeded_and_poor() -> None:
    task = ReachTask(preset_named("fast"), design_named("2-L"), seed=0)
    task.reset(0)
    policy, again = random_policy(3), random_policy(3)
    drawn = np.array([policy(task) for _ in range(2000)])
    np.testing.assert_array_equal(drawn[:5], [again(task) for _ in range(5)])
    assert np.abs(drawn).max() <= 1.5
    np.testing.assert_allclose(drawn.std(axis=0), 1.5 / math.sqrt(3), rtol=0.05)
    assert mean_reward(task, random_policy(0), 20) < -0.8
