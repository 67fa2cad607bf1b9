"""Contacts and sleeping: what touches what, and that sleeping changes nothing but the speed."""

from typing import ClassVar

import mujoco
import numpy as np
import pytest

from pa_ros.arena import (
    ArenaConfig,
    Design,
    Kind,
    ReachTask,
    design_named,
    mean_reward,
    preset_named,
    random_policy,
    scripted_action,
)
from pa_ros.arena.appearance import RESTING_DEPTH_M
from pa_ros.arena.references import nearest_target, toward
from pa_ros.language import Vocabulary

PAPER, FAST = preset_named("paper"), preset_named("fast")
STILL = np.zeros(6)


class AwakeConfig(ArenaConfig):
    """An arena whose blocks never sleep."""

    sleep: ClassVar[bool] = False


def of_shapes(*shapes: str) -> Design:
    """A red block of each shape on the table."""
    values = {"shape": shapes, "color": ("RED",)}
    target = Kind(color="RED", shape=shapes[0])
    return Design("own", values, Vocabulary.of(**values), (target,), n_blocks=len(shapes))


def contacts(task: ReachTask) -> set[str]:
    model, simulated = task.simulation.model, task.simulation.data
    mujoco.mj_collision(model, simulated)
    found = set()
    for contact in simulated.contact:
        names = [model.body(model.geom_bodyid[geom]).name for geom in contact.geom]
        found.add(" ".join(sorted(name.rstrip("0123456789") for name in names)))
    return found


def pushed(config: ArenaConfig) -> tuple[float, set[str]]:
    """Drive the hand at the target: the farthest that a block moved (m), and the contacts."""
    task = ReachTask(config, design_named("2-L"), seed=0)
    farthest, touching = 0.0, set()
    for episode in range(6):
        _, verdict = task.reset(episode)
        start = task.simulation.positions
        while not verdict.truncated:
            _, verdict = task.step(toward(task, nearest_target(task) - [0, 0, 0.05]))
            touching |= contacts(task)
        moved = np.linalg.norm((task.simulation.positions - start)[1:, :2], axis=1)
        farthest = max(farthest, float(moved.max()))
    return farthest, touching


def test_the_arm_of_paper_pushes_blocks() -> None:
    farthest, touching = pushed(PAPER)
    assert farthest > 0.02
    assert "block hand" in touching


def test_the_arm_of_fast_passes_through_blocks_but_not_through_the_table() -> None:
    farthest, touching = pushed(FAST)
    assert farthest == 0.0
    assert "hand world" in touching
    assert not touching & {"block hand", "block link"}


def test_the_arm_never_touches_itself() -> None:
    task = ReachTask(PAPER, design_named("2-L"), seed=0)
    rng = np.random.default_rng(0)
    task.reset(0)
    low, high = np.array(PAPER.joint_lower), np.array(PAPER.joint_upper)
    for _ in range(200):
        task.simulation.data.qpos[:6] = rng.uniform(low, high)
        mujoco.mj_forward(task.simulation.model, task.simulation.data)
        assert not {"link link", "hand link", "hand hand"} & contacts(task)


def test_contact_costs_the_script_at_most_a_tenth_of_its_score() -> None:
    scores = {}
    for touches in (True, False):
        config = PAPER.changed(arm_touches_blocks=touches)
        task = ReachTask(config, design_named("2-L"), seed=1)
        scores[touches] = mean_reward(task, scripted_action, 40)
    assert scores[True] >= 0.9 * scores[False]
    assert 0.5 < scores[True] < 0.7  # the paper: "~0.6 is effectively perfect"
    assert mean_reward(task, random_policy(0), 20) < -0.9


@pytest.mark.parametrize("config", [PAPER, FAST], ids=lambda config: config.preset)
def test_sleeping_changes_no_feature_and_no_reward(config: ArenaConfig) -> None:
    awake = ReachTask(AwakeConfig(**config.fields()), design_named("2-L"), seed=0)
    asleep = ReachTask(config, design_named("2-L"), seed=0)
    for episode in range(5):
        _, verdict = awake.reset(episode)
        asleep.reset(episode)
        while not verdict.truncated:
            command = scripted_action(awake)
            (one, verdict), (other, other_verdict) = awake.step(command), asleep.step(command)
            assert verdict.reward == other_verdict.reward
            np.testing.assert_allclose(one.objects, other.objects, atol=2e-5)


def test_all_blocks_sleep_until_touched() -> None:
    task = ReachTask(FAST, design_named("2-L"), 0)
    task.reset(0)
    for _ in range(20):
        task.step(np.full(6, 0.5))
    np.testing.assert_array_equal(task.simulation.data.tree_awake, [1, 0, 0, 0, 0])


def test_awake_blocks_rest_at_the_resting_depths() -> None:
    task = ReachTask(AwakeConfig(**PAPER.fields()), of_shapes(*RESTING_DEPTH_M), 0)
    task.reset(0)
    start = task.simulation.positions
    for _ in range(50):
        task.step(STILL)
        np.testing.assert_allclose(task.simulation.positions[1:], start[1:], atol=5e-5)
