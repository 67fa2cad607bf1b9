"""What touches what in each preset, and that a fair script doesn't pay for it."""

import mujoco
import numpy as np
import pytest

from helpers.scripts import clumsy_action
from pa_ros.arena import ArenaConfig, ReachTask, design_named, preset_named, scripted_action
from pa_ros.arena.references import mean_reward, nearest_target, random_policy, toward

PAPER, FAST = preset_named("paper"), preset_named("fast")


def pushed(config: ArenaConfig) -> tuple[float, set[str]]:
    """Drive the hand at the target's center: farthest block moved (m), and who touched whom."""
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


def contacts(task: ReachTask) -> set[str]:
    model, simulated = task.simulation.model, task.simulation.data
    mujoco.mj_collision(model, simulated)
    found = set()
    for contact in simulated.contact:
        names = [model.body(model.geom_bodyid[geom]).name for geom in contact.geom]
        found.add(" ".join(sorted(name.rstrip("0123456789") for name in names)))
    return found


def test_paper_arm_pushes_blocks_about() -> None:
    farthest, touching = pushed(PAPER)
    assert farthest > 0.02
    assert "block hand" in touching


def test_fast_arm_passes_through_blocks_but_not_through_the_table() -> None:
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
    random = random_policy(0)
    free = PAPER.changed(arm_touches_blocks=False)
    scores = {}
    for name, config in (("with", PAPER), ("without", free)):
        task = ReachTask(config, design_named("2-L"), seed=1)
        scores[name] = mean_reward(task, scripted_action, 60)
        scores["random"] = mean_reward(task, random, 20)
    assert scores["with"] >= 0.9 * scores["without"]
    assert 0.5 < scores["with"] < 0.7  # "~0.6 is effectively perfect"
    assert scores["random"] < -0.9


def test_blocks_are_not_knocked_away_by_a_clumsy_script() -> None:
    task = ReachTask(PAPER, design_named("2-L"), seed=0)
    for episode in range(20):
        task.reset(episode)
        verdict = task.step(clumsy_action(task))[1]
        while not verdict.truncated:
            _, verdict = task.step(clumsy_action(task))
        assert (task.simulation.positions[1:, 2] > 0).all()  # none fell off the table


@pytest.mark.parametrize("shape", ["CUBE", "SPHERE", "CYLINDER", "CAPSULE"])
def test_every_shape_can_be_pushed_and_rests_again(shape: str) -> None:
    from pa_ros.arena import Design, Kind
    from pa_ros.arena.appearance import look_of
    from pa_ros.language import Vocabulary

    values, kind = {"shape": (shape,), "color": ("RED",)}, Kind(color="RED", shape=shape)
    design = Design("one", values, Vocabulary.of(**values), (kind,), n_blocks=1)
    task = ReachTask(PAPER, design, seed=0)
    task.reset(0)
    task.simulation.data.qvel[6:9] = 0.3, 0.2, 0.0  # a nudge wakes it
    for _ in range(100):
        task.step(np.zeros(6))
    assert np.linalg.norm(task.simulation.data.qvel[6:9]) < 0.01
    height = task.simulation.positions[1, 2]
    assert height == pytest.approx(look_of(kind).rest_height, abs=1e-3)
