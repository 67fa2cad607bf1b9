"""Arms: properties of every arm, and the published numbers of the Panda."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from pa_ros.arena import (
    ARMS,
    ArenaConfig,
    ArmModel,
    ReachTask,
    design_named,
    mean_reward,
    preset_named,
    random_policy,
    scripted_action,
)
from pa_ros.arena.arms.panda import LINKS
from pa_ros.core.errors import ConfigError

CONFIGS = [preset_named(preset, arm) for arm in ARMS for preset in ("fast", "paper")]
every_setting = pytest.mark.parametrize("config", CONFIGS, ids=lambda c: f"{c.arm}-{c.preset}")
every_arm = pytest.mark.parametrize("arm", [ARMS[name] for name in ARMS], ids=lambda arm: arm.name)


def task_of(config: ArenaConfig) -> ReachTask:
    return ReachTask(config, design_named("2-L"), seed=0)


def panda() -> ReachTask:
    task = task_of(preset_named("fast", "panda"))
    task.reset(0)
    return task


@every_setting
def test_the_script_scores_well_and_random_actions_do_not(config: ArenaConfig) -> None:
    task = task_of(config)
    assert mean_reward(task, random_policy(0), 20) < -0.9
    assert mean_reward(task, scripted_action, 20) > (0.8 if config.preset == "fast" else 0.5)


@every_setting
def test_a_commanded_velocity_is_reached_within_one_period(config: ArenaConfig) -> None:
    task, rng = task_of(config), np.random.default_rng(0)
    limits, errors = np.array(config.joint_speed_limits), []
    for episode in range(20):
        task.reset(episode)
        command = limits * rng.uniform(-1, 1, config.joints)
        observation, _ = task.step(command)
        errors.append(np.abs(observation.joint_velocity - command) / limits)
    assert np.mean(errors) < 0.03


@every_setting
def test_the_arm_starts_near_no_block_and_stays_in_its_range(config: ArenaConfig) -> None:
    task, policy = task_of(config), random_policy(1)
    low, high = np.array(config.joint_lower), np.array(config.joint_upper)
    if ARMS[config.arm].joints[0].limits is None:
        low[0], high[0] = -math.inf, math.inf
    for episode in range(5):
        observation, verdict = task.reset(episode)
        assert not verdict.satisfied
        assert task.simulation.positions[0, 2] == pytest.approx(0.28, abs=0.005)
        while not verdict.truncated:
            observation, verdict = task.step(policy(task))
            assert (observation.joint_position > low - 0.1).all()
            assert (observation.joint_position < high + 0.1).all()


@pytest.mark.parametrize(
    ("change", "shown"),
    [
        ({"joints": ()}, "1 to 16 joints, got 0"),
        ({"joints": ARMS["jaco"].joints[:1] * 6}, "different joint names"),
        ({"speeds": {"fast": (1.0,) * 5}}, "preset fast: expected 6, got 5"),
    ],
)
def test_wrong_arms_are_rejected(change, shown) -> None:  # type: ignore[no-untyped-def]
    one = replace(ARMS["jaco"], joints=ARMS["jaco"].joints[:1], speeds={"fast": (1.0,)})
    assert one.joint_names == ("joint_1",)
    with pytest.raises(ConfigError, match=shown):
        replace(ARMS["jaco"], **change)


def bodies(*names: str) -> str:
    return "".join(f'<body><joint name="{name}"/><geom size="1"/></body>' for name in names)


NAMES = ARMS["jaco"].joint_names


@pytest.mark.parametrize(
    ("mjcf", "shown"),
    [
        ("<body>", "expected MJCF bodies, got: .*XML"),
        (bodies(*NAMES[::-1]), r"expected hinges \['joint_1', .*got \['joint_6', "),
        (bodies(*NAMES), "expected `hand` as its last body"),
    ],
)
def test_a_model_of_another_arm_is_rejected(mjcf, shown, monkeypatch, tmp_path) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log here
    other = replace(ARMS["jaco"], mjcf=lambda attributes: mjcf)
    monkeypatch.setattr("pa_ros.arena.model.ARMS", {"jaco": other})
    with pytest.raises(ConfigError, match=f"(?s)arm jaco: .*{shown}"):
        task_of(preset_named("fast")).reset(0)


def test_the_pandas_chain_is_the_published_one() -> None:
    """Upright at zero: 0.333 + 0.316 + 0.384 m high and 0.088 m out, then flange and hand down."""
    task = panda()
    task.simulation.data.qpos[:7] = 0.0
    mujoco.mj_kinematics(task.simulation.model, task.simulation.data)
    np.testing.assert_allclose(
        task.simulation.link_positions,
        [[0, 0, 0.333], [0, 0, 0.333], [0, 0, 0.649], [0.0825, 0, 0.649],
         [0, 0, 1.033], [0, 0, 1.033], [0.088, 0, 1.033], [0.088, 0, 0.8226]],
        atol=1e-12,
    )  # fmt: skip
    assert sum(link.mass_kg for link in LINKS) == pytest.approx(16.06, abs=0.01)


def test_blocks_lie_within_the_sector_of_the_arm() -> None:
    config = preset_named("fast", "panda")
    task = ReachTask(config, replace(design_named("3-D"), n_blocks=8), seed=0)
    for episode in range(20):
        task.reset(episode)
        x, y = task.simulation.positions[1:, :2].T
        assert (np.abs(np.arctan2(y, x)) <= ARMS["panda"].block_angles[1]).all()
        assert abs(task.episode.arm_start[0]) + ARMS["panda"].block_angles[1] < np.pi


@every_arm
def test_the_preset_paper_stays_within_the_speeds_of_the_real_arm(arm: ArmModel) -> None:
    for speed, joint in zip(arm.speeds["paper"], arm.joints, strict=True):
        assert speed <= joint.max_speed
