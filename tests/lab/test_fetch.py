"""The world that Fetch is to us, and what its benchmark reports."""

import sys
from argparse import Namespace
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from laboratory.benchmarks import fetch
from laboratory.benchmarks.fetch import PUT, REACH, FetchScore, FetchTask
from laboratory.studies.tables import read_rows, write_rows
from pa_ros.core.errors import ConfigError
from pa_ros.world.poses import places

pytestmark = pytest.mark.filterwarnings("ignore")  # of gymnasium_robotics and stable_baselines3


@pytest.fixture
def robotics() -> None:
    pytest.importorskip("gymnasium_robotics")


@pytest.mark.parametrize("env", fetch.ENVIRONMENTS)
def test_where_a_program_holds_fetch_says_success(env: str, robotics) -> None:
    environment, rng = fetch.make(env), np.random.default_rng(0)
    seen, _ = environment.reset(seed=1)
    scoring = fetch.FetchScoring({"NEAR": 0.08})
    for away in np.linspace(0.0, 0.1, 20):  # goals around the block
        way = rng.standard_normal(3)
        goal = seen["achieved_goal"] + away * way / np.linalg.norm(way)
        now = fetch.observed(seen, PUT, goal)
        score = scoring.of_program(PUT, ((1,), (2,)), now.objects, now.hand_pose)
        assert score.measure == pytest.approx(away, abs=1e-6)
        judge: Any = environment.unwrapped
        success = judge._is_success(seen["achieved_goal"], goal)  # noqa: SLF001
        assert score.satisfied == (away < fetch.NEAR_M)
        assert success or not score.satisfied
    where = places(now.hand_pose, now.objects) + fetch.TABLE_M
    expected = [seen["observation"][:3], seen["achieved_goal"], goal]
    np.testing.assert_allclose(where, expected, atol=1e-6)


def test_the_agent_sees_how_far_the_block_moved_in_the_last_step(robotics) -> None:
    environment = fetch.make("push")
    seen, _ = environment.reset(seed=1)
    moved, told = [], []
    while len(moved) < 50:  # the hand goes to the block and pushes it
        before, way = seen["achieved_goal"], seen["achieved_goal"] - seen["observation"][:3]
        action = np.array([*np.clip(10 * way, -1, 1), 0], np.float32)
        seen = environment.step(action)[0]
        moved.append(seen["achieved_goal"] - before)
        told.append(fetch.FAST_M * fetch.observed(seen, PUT).joint_position[:3])
    assert np.abs(moved).max() > 0.005
    assert np.corrcoef(np.ravel(moved), np.ravel(told))[0, 1] > 0.8
    assert np.linalg.norm(told) == pytest.approx(np.linalg.norm(moved), rel=0.3)


def test_a_guided_episode_goes_on_to_the_goal_once_the_hand_is_at_the_block(robotics) -> None:
    task = FetchTask("push", seed=0)
    programs = {}
    for index in range(8):
        now, verdict = task.reset(index)
        programs[task.program] = index
    assert set(programs) == {PUT, REACH}
    again, _ = task.reset(programs[REACH])
    repeated, _ = FetchTask("push", seed=0).reset(programs[REACH])
    np.testing.assert_array_equal(again.objects, repeated.objects)
    now, steps = again, 0
    while task.program is REACH:
        beside = now.objects[2, :3] - now.objects[1, :3]
        assert np.hypot(*beside[:2]) == pytest.approx(fetch.BESIDE_M["push"], abs=0.01)
        assert beside[2] == pytest.approx(0.0, abs=1e-3)
        way = now.objects[2, :3] / fetch.STEP_M
        now, verdict = task.step(np.clip([*way, 0.0], -1, 1).astype(np.float64))
        steps += 1
        assert now.program_id == str(task.program) and now.step == steps
    assert steps > 0
    while not verdict.truncated:
        now, verdict = task.step(np.zeros(4))
    assert now.step == fetch.STEPS


def test_a_training_episode_ends_when_the_block_has_left_the_table(robotics) -> None:
    task = FetchTask("push", seed=0)
    task.reset(0)
    _, verdict = task.step(np.zeros(4))
    assert not verdict.truncated
    fetch_env: Any = task._env.unwrapped  # noqa: SLF001
    beside_the_table = [1.7, 0.75, 0.1, 1.0, 0.0, 0.0, 0.0]
    model, data = fetch_env.model, fetch_env.data
    fetch_env._utils.set_joint_qpos(model, data, "object0:joint", beside_the_table)  # noqa: SLF001
    _, verdict = task.step(np.zeros(4))
    assert verdict.truncated


def test_ours_and_a_peer_are_scored_on_the_same_episodes(robotics, tmp_path, monkeypatch) -> None:
    pytest.importorskip("sb3_contrib")
    monkeypatch.setattr(fetch, "EVERY", 100)
    monkeypatch.setattr(fetch, "TRIED", 1)
    monkeypatch.setattr(fetch, "EPISODES", 2)
    monkeypatch.setitem(fetch.CHANGED, "learner.replay.warmup_frames", 150)
    options = Namespace(env="pick", seeds=1, first_seed=3, frames=200, minutes=0.0,
                        contenders=["ours", "TQC"], runs=tmp_path)  # fmt: skip
    found = fetch.run(options)
    assert found["fetch.pick.ours.frames"] == 200 and found["fetch.pick.TQC.frames"] == 1
    rows = read_rows(tmp_path / "pick-ours-3.csv", FetchScore)
    assert [(row.frames, row.episodes) for row in rows] == [(100, 1), (200, 1), (200, 2)]
    assert 0 < rows[0].seconds < rows[1].seconds


def test_finished_runs_are_not_repeated_and_a_missing_library_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium_robotics", None)
    row = FetchScore("push", "ours", 0, 5_000, 10.0, 100, 0.2)
    for seed, shares in enumerate([(0.2, 0.96, 0.9), (0.3, 0.4, 0.97), (0.1, 0.2, 0.3)]):
        rows = [replace(row, seed=seed, frames=5_000 * i, success=share)
                for i, share in enumerate(shares, start=1)]  # fmt: skip
        write_rows(tmp_path / f"push-ours-{seed}.csv", rows)
    options = Namespace(env="push", seeds=3, first_seed=0, frames=None, minutes=1.0,
                        contenders=["ours"], runs=tmp_path)  # fmt: skip
    found = fetch.run(options)
    assert found["fetch.push.ours.success"] == 0.9
    assert found["fetch.push.ours.solved"] == 2
    assert found["fetch.push.ours.frames_to_solve"] == 15_000
    options.seeds = 4
    with pytest.raises(ConfigError, match="ours needs gymnasium_robotics"):
        fetch.run(options)
