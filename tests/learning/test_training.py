"""The loop: lag, order, resuming, and a problem that DPG must solve."""

import csv
import itertools
import shutil
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from helpers.worlds import (
    ENVIRONMENT,
    NETWORK,
    PROGRAMS,
    SCORING,
    SETTINGS,
    SPEED,
    WORLD,
    PointWorld,
    dpg,
    run,
)
from pa_ros.acting.errors import ActingError
from pa_ros.acting.executing import Actor
from pa_ros.acting.exploration import ExplorationNoise
from pa_ros.core.errors import ConfigError
from pa_ros.language import PRODUCT
from pa_ros.learning import records
from pa_ros.learning.checkpoints import load_policy, restore, save_checkpoint
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.errors import CheckpointError, DivergedError
from pa_ros.learning.folder import claim
from pa_ros.learning.learner import Learner
from pa_ros.learning.loop import train
from pa_ros.learning.progress import ProgressLog
from pa_ros.networks.config import NetworkConfig
from pa_ros.world import Trajectory

CHANGING: dict[str, Any] = {"detectors__sparsity": 0.5, "relabeling__property_dropout": 0.5}


def assert_same(one: Learner, two: Learner) -> None:
    """Everything that a learner is, bit for bit."""
    assert one.counters == two.counters
    assert one.rng.bit_generator.state == two.rng.bit_generator.state
    assert one.replay.to_metadata() == two.replay.to_metadata()
    for ours, theirs in (
        (one.engine.tensors(), two.engine.tensors()),
        (one.replay.filled(), two.replay.filled()),
    ):
        assert ours.keys() == theirs.keys()
        for name in ours:
            np.testing.assert_array_equal(ours[name], theirs[name])
    for snapshot, other in zip(one.published, two.published, strict=True):
        assert snapshot.version == other.version
        for name, tensor in snapshot.tensors.items():
            np.testing.assert_array_equal(tensor, other.tensors[name])


def consumed(monkeypatch: pytest.MonkeyPatch) -> list[Trajectory]:
    """Every trajectory that any learner consumes from here on."""
    trajectories: list[Trajectory] = []
    original = Learner.consume

    def consume(self: Learner, trajectory: Trajectory) -> bool:
        trajectories.append(trajectory)
        return original(self, trajectory)

    monkeypatch.setattr(Learner, "consume", consume)
    return trajectories


@pytest.mark.parametrize(("lag", "steps"), [(0, 1), (0, 20), (1, 7), (1, 20), (3, 7)])
def test_lag(tmp_path, monkeypatch, lag, steps) -> None:
    """Trajectory m is acted by version m − lag, and the weights are those of that version."""
    trajectories = consumed(monkeypatch)
    settings = dpg(SETTINGS, schedule__policy_lag=lag, schedule__trajectory_steps=steps)
    learner = run(tmp_path, 60, settings)
    assert [s.sequence for s in trajectories] == list(range(len(trajectories)))
    for m, trajectory in enumerate(trajectories):
        assert trajectory.policy_version == max(0, m - lag)
    ends = {s.first_step + len(s) for s in trajectories if s.ends_episode}
    assert ends == {20} and sum(len(s) for s in trajectories) == 60
    assert all(len(s) == steps for s in trajectories if not s.ends_episode)
    assert learner.counters.version == len(trajectories)
    assert [p.version for p in learner.published] == list(
        range(max(0, len(trajectories) - lag), len(trajectories) + 1)
    )


def test_actions_are_those_of_the_version_they_claim(tmp_path, monkeypatch) -> None:
    """Replaying the learner alone gives the policies that explain every action."""
    trajectories = consumed(monkeypatch)
    run(tmp_path, 100)
    monkeypatch.undo()
    learner = Learner(NETWORK, SETTINGS, PROGRAMS, 3, SCORING)
    policies = {0: learner.snapshot()}
    world = PointWorld(3)
    noise = ExplorationNoise(SETTINGS.exploration, world.control_period_s, seed=3, actions=6)
    actor = Actor(NETWORK, noise=noise, logic=PRODUCT)
    for episode, trajectory in enumerate(trajectories):
        actor.load(policies[trajectory.policy_version])
        observation, _ = world.reset(episode)
        for t in range(len(trajectory)):
            np.testing.assert_array_equal(observation.objects, trajectory.objects[t])
            action = actor.explore(observation, world.program)
            np.testing.assert_array_equal(action, trajectory.actions[t])
            observation, verdict = world.step(action.astype(np.float64))
            assert verdict.reward == trajectory.rewards[t]
        learner.consume(trajectory)
        policies[learner.counters.version] = learner.snapshot()


@pytest.mark.parametrize(
    ("engine", "lag", "per_frame"), [("auto", 0, 0.7), ("auto", 1, 0.7), ("torch", 1, 0.15)]
)
def test_resuming_is_not_stopping(tmp_path, engine, lag, per_frame) -> None:
    """Also across the replay's wrap, at 500 rows, and whatever changes with the updates."""
    schedule = {"schedule__policy_lag": lag, "updates__per_frame": per_frame}
    settings = dpg(SETTINGS, engine__name=engine, **schedule, **CHANGING)
    unbroken = run(tmp_path / "a", 800, settings, evaluate_every_frames=40)
    run(tmp_path / "b", 260, settings, evaluate_every_frames=40)
    run(tmp_path / "b", 600, settings, resume=True, evaluate_every_frames=40)
    assert_same(unbroken, run(tmp_path / "b", 800, settings, True, evaluate_every_frames=40))

    def curve(name: str) -> list[dict[str, str]]:
        with (tmp_path / name / "progress.csv").open(newline="") as file:
            return [{k: v for k, v in row.items() if k != "wall_s"} for row in csv.DictReader(file)]

    assert [float(row["frames"]) for row in curve("a")] == list(range(40, 801, 40))
    assert curve("a") == curve("b")
    with (tmp_path / "b/progress.csv").open(newline="") as file:
        walls = [float(row["wall_s"]) for row in csv.DictReader(file)]
    assert 0 < walls[0] and walls == sorted(walls) and walls[-1] < 600


def test_a_run_cut_off_repeats_what_its_checkpoint_lacks(tmp_path) -> None:
    """progress.csv loses the rows after the checkpoint, and gets them again, the same."""
    out, kept = tmp_path / "run", tmp_path / "kept"
    run(out, 100, evaluate_every_frames=20)
    shutil.copytree(out / "checkpoint", kept)
    run(out, 200, resume=True, evaluate_every_frames=20)
    final = load_policy(out / "checkpoint")
    shutil.rmtree(out / "checkpoint")
    shutil.move(kept, out / "checkpoint")
    run(out, 200, resume=True, evaluate_every_frames=20)
    with (out / "progress.csv").open(newline="") as file:
        assert [float(row["frames"]) for row in csv.DictReader(file)] == list(range(20, 201, 20))
    for name, tensor in load_policy(out / "checkpoint").tensors.items():
        np.testing.assert_array_equal(tensor, final.tensors[name])


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"environment": ENVIRONMENT | {"design": "3-D"}}, "design: expected '3-D'"),
        ({"environment": ENVIRONMENT | {"preset": "paper"}}, "preset: expected 'paper'"),
        ({"seed": 4}, "seed: expected 4, got 3"),
    ],
)
def test_another_runs_checkpoint_is_refused(tmp_path, changed, reason) -> None:
    run(tmp_path, 20)
    kept = (tmp_path / "progress.csv").read_bytes()
    with pytest.raises(CheckpointError, match=reason):
        run(tmp_path, 40, resume=True, **changed)
    assert (tmp_path / "progress.csv").read_bytes() == kept


def test_settings_that_are_refused_leave_no_folder(tmp_path) -> None:
    with pytest.raises(ConfigError, match="device"):
        run(tmp_path / "run", 20, dpg(engine__device="meta"))
    assert not (tmp_path / "run").exists()


def test_a_folder_that_holds_a_run_is_resumed_or_refused(tmp_path) -> None:
    run(tmp_path, 60, evaluate_every_frames=20)
    kept = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(CheckpointError, match=r"expected a folder without a run.*--resume"):
        run(tmp_path, 40, evaluate_every_frames=20)
    with claim(tmp_path, resume=True), pytest.raises(CheckpointError, match="another run writes"):
        run(tmp_path, 40, resume=True)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == kept
    assert run(tmp_path, 80, resume=True).counters.frames == 80


def test_a_watcher_receives_each_episodes_mean_reward_and_each_row(tmp_path) -> None:
    asked, watcher = TrainConfig(out=tmp_path, frames=40, evaluate_every_frames=40), Mock()
    train(asked, NETWORK, SETTINGS, PointWorld(0), SPEED, PROGRAMS, watcher=watcher)
    (first, second), ((row,), _) = watcher.episode.call_args_list, watcher.row.call_args
    assert [call.args[:2] for call in (first, second)] == [(20, 20), (40, 20)]
    means = [call.args[2] for call in (first, second)]
    assert row["frames"] == 40.0 and -1.0 <= min(means)
    assert row["behaviour.reward_per_step"] == pytest.approx(sum(means) / 2)


def test_checkpoints_are_written_on_the_way(tmp_path, monkeypatch) -> None:
    versions: list[int] = []

    def save(root: Path, learner: Learner, extra: dict) -> Path:
        versions.append(learner.counters.version)
        return save_checkpoint(root, learner, extra)

    monkeypatch.setattr(records, "save_checkpoint", save)
    run(tmp_path, 200, checkpoint_every_frames=50)
    # After 50, 100, 150 and 200 frames, of which no episode of 20 ends at 50 or 150.
    assert versions == [3, 5, 8, 10, 10]
    directories = [p.name for p in (tmp_path / "checkpoint").iterdir()]
    assert sorted(directories) == ["LATEST", "version-000000008", "version-000000010"]


def test_learning_that_diverges_stops_and_the_last_two_good_checkpoints_stay(tmp_path) -> None:
    """Rates that no network survives: the curve ends in an error, not in NaN."""
    wild = dpg(SETTINGS, optimizer__critic_rate=1e30, replay__warmup_frames=60)
    with pytest.raises(DivergedError, match=r"expected finite numbers.*critic_loss.*at update"):
        run(tmp_path, 200, wild, checkpoint_every_frames=20, evaluate_every_frames=0)
    kept = sorted((tmp_path / "checkpoint").glob("version-*"))
    assert len(kept) == 2
    for path in kept:
        restore(path, Learner(NETWORK, wild, PROGRAMS, 3, SCORING))
        assert all(np.isfinite(tensor).all() for tensor in load_policy(path).tensors.values())


def test_of_learning_that_diverges_the_state_before_is_saved(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("pa_ros.learning.learner.SAVED_BEFORE", 1)
    wild = dpg(SETTINGS, optimizer__critic_rate=1e30, replay__warmup_frames=60)
    with pytest.raises(DivergedError) as caught:
        run(tmp_path, 200, wild, checkpoint_every_frames=0, evaluate_every_frames=0)
    (kept,) = (tmp_path / "checkpoint").glob("version-*")
    assert f"stopped after version {int(kept.name[8:])}," in str(caught.value)
    learner = Learner(NETWORK, wild, PROGRAMS, 3, SCORING)
    restore(kept, learner)
    assert all(np.isfinite(tensor).all() for tensor in learner.engine.tensors().values())


@pytest.mark.parametrize("full_for", [2, 99])
def test_a_full_disk_costs_checkpoints_on_the_way_but_the_last_must_be_saved(
    tmp_path, monkeypatch, caplog, full_for
) -> None:
    often: dict[str, Any] = {"evaluate_every_frames": 40, "checkpoint_every_frames": 60}
    uninterrupted = run(tmp_path / "a", 200, **often)
    attempts = itertools.count()

    def save(root: Path, learner: Learner, extra: dict) -> Path:
        if next(attempts) < full_for:
            raise CheckpointError("full")
        return save_checkpoint(root, learner, extra)

    monkeypatch.setattr(records, "save_checkpoint", save)
    if full_for > 3:
        with pytest.raises(CheckpointError, match="full"):
            run(tmp_path / "b", 200, **often)
        return
    assert_same(uninterrupted, run(tmp_path / "b", 200, **often))
    assert caplog.text.count("learning continues, and is saved when there is room") == 2
    assert load_policy(tmp_path / "b/checkpoint").version == uninterrupted.counters.version


def test_a_row_that_had_no_room_is_written_with_the_next(tmp_path, monkeypatch) -> None:
    progress = ProgressLog(tmp_path / "progress.csv")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", Mock(side_effect=OSError(28, "full")))
        with pytest.raises(OSError, match="full"):
            progress.add({"frames": 1.0})
    progress.add({"frames": 2.0, "score": 0.5})  # it may also have other columns
    rows = (tmp_path / "progress.csv").read_text().split()
    assert rows == ["frames,score", "1.0,nan", "2.0,0.5"]


def test_an_error_of_the_learner_reaches_the_caller(tmp_path, monkeypatch) -> None:
    def consume(self: Learner, trajectory: Trajectory) -> bool:
        raise ActingError("no")

    monkeypatch.setattr(Learner, "consume", consume)
    with pytest.raises(ActingError, match="no"):
        run(tmp_path, 200)


def mean_reward(actor: Actor, episodes: range) -> float:
    """Greedy reward per step."""
    world = PointWorld(3)
    rewards = []
    for episode in episodes:
        observation, verdict = world.reset(episode)
        while not verdict.truncated:
            action = actor.act(observation, world.program).astype(np.float64)
            observation, verdict = world.step(action)
            rewards.append(verdict.reward)
    return float(np.mean(rewards))


def test_dpg_solves_the_point_world(tmp_path) -> None:
    """From about −1 to most of the time near the block that the program names."""
    network = NetworkConfig(world=WORLD, family="true-properties", hidden=32, attention=8)
    settings = dpg(
        SETTINGS, replay__batch_size=64, replay__capacity_frames=20_000, replay__warmup_frames=200,
        optimizer__actor_rate=1e-3,
        optimizer__critic_rate=2e-3, updates__discount=0.9, relabeling__programs_per_transition=2,
    )  # fmt: skip
    learner = run(tmp_path, 4000, settings, network=network, evaluate_every_frames=0)
    before = Actor(network)
    before.load(Learner(network, settings, PROGRAMS, 3, SCORING).snapshot())
    episodes = range(10_000, 10_030)
    assert mean_reward(before, episodes) < -0.8
    assert mean_reward(Actor.of(learner.snapshot()), episodes) > 0.3
