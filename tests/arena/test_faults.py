"""The preset `robot`: an arena with the faults of a real arm, for agents that are to move one."""

import numpy as np
import pytest

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.arena.faults import DROPPED, LATE, LOST, LOST_S, NOISE_M, NOISE_RAD, Faults
from pa_ros.world.poses import IDENTITY

STEPS, PERIOD_S = 20_000, 0.1
TRUE = np.zeros((3, 16), np.float32)
TRUE[:, 6], TRUE[1:, :3], TRUE[1:, 7] = 1.0, [[0.1, 0.2, 0.3], [-0.2, 0.1, -0.1]], 1.0


def test_poses_are_noisy_and_an_object_that_is_lost_keeps_its_own() -> None:
    faults = Faults(0, 0, PERIOD_S)
    seen = np.stack([faults.measured(TRUE, IDENTITY) for _ in range(STEPS)])
    assert (seen[:, 0] == TRUE[0]).all() and (seen[:, :, 7:] == TRUE[:, 7:]).all()
    off = seen[:, 1:, :3] - TRUE[1:, :3]
    assert off.std() == pytest.approx(NOISE_M, rel=0.03) and abs(off.mean()) < 2e-4
    assert 2 * seen[:, 1:, 3:6].std() == pytest.approx(NOISE_RAD, rel=0.03)
    assert np.linalg.norm(seen[:, 1:, 3:7], axis=-1) == pytest.approx(1.0, abs=1e-6)
    kept = (seen[1:, 1:] == seen[:-1, 1:]).all(-1)
    assert kept.mean() == pytest.approx(DROPPED + LOST * LOST_S, rel=0.2)
    runs = np.diff(np.flatnonzero(np.diff(kept[:, 0].astype(int), prepend=0, append=0)))[::2]
    assert max(runs) >= LOST_S / PERIOD_S


def test_an_object_seen_before_the_hand_moved_is_where_it_was_on_the_table() -> None:
    faults = Faults(0, 0, PERIOD_S)
    faults.measured(TRUE, IDENTITY)
    faults._missing[:] = 5  # noqa: SLF001 - lost
    hand, moved = np.array([0.1, 0, 0, 0, 0, 0, 1.0]), TRUE.copy()
    moved[1:, 0] -= 0.1
    seen = faults.measured(moved, hand)
    assert seen[1:, :3] == pytest.approx(moved[1:, :3], abs=5 * NOISE_M)
    assert len(faults.measured(TRUE[:2], hand)) == 2, "other objects"


def test_commands_come_late_in_some_episodes_and_the_arm_continues_where_one_is_lost() -> None:
    late = 0
    for episode in range(200):
        faults, sent = Faults(0, episode, PERIOD_S), np.arange(1.0, 101.0)[:, None]
        done = np.concatenate([faults.command(one) for one in sent])
        behind = sent[:, 0] - done
        late += bool(np.median(behind) == 1)
        assert np.median(behind) in (0, 1) and behind.min() == np.median(behind)
    assert late / 200 == pytest.approx(LATE, abs=0.1)


def test_an_arena_with_faults_repeats_itself_and_is_judged_by_the_truth() -> None:
    config, design = preset_named("robot"), design_named("2-L")
    tasks = [ReachTask(config, design, 3) for _ in range(2)]
    for index in (0, 1):
        for seen, again in zip(*(play(task, index) for task in tasks), strict=True):
            np.testing.assert_array_equal(seen[0].objects, again[0].objects)
            assert seen[1] == again[1]
    task = tasks[0]
    observation, verdict = task.set_program(task.goal)
    assert task.set_program(task.goal)[0].objects is observation.objects, "measured once"
    true = task.verifier.score(task.simulation.objects(), task.simulation.hand_pose)
    assert verdict.distance == true.measure
    told = task.verifier.score(observation.objects, observation.hand_pose)
    assert verdict.distance != told.measure


def play(task: ReachTask, index: int) -> list:
    rng, steps = np.random.default_rng(index), [task.reset(index)]
    return steps + [task.step(rng.uniform(-1, 1, 6)) for _ in range(30)]
