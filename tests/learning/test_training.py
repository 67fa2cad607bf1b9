"""The loop: lag, order, resuming, and a problem that DPG must solve."""

from __future__ import annotations

import csv
import errno
import fcntl
import json
import os
import shutil
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from helpers.worlds import NETWORK, PROGRAMS, SCORING, SETTINGS, WORLD, PointWorld, dpg, run
from pa_ros.acting.actor import Actor
from pa_ros.acting.errors import ActingError
from pa_ros.acting.exploration import ExplorationNoise
from pa_ros.bags.format import FolderLock
from pa_ros.core.errors import ConfigError
from pa_ros.language import PRODUCT
from pa_ros.learning import records
from pa_ros.learning.checkpoint_files import find_checkpoint
from pa_ros.learning.checkpoints import load_policy, read_metadata, restore, save_checkpoint
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.errors import CheckpointError, DivergedError, FolderTakenError
from pa_ros.learning.folder import claim
from pa_ros.learning.learner import ConsumeReport, Learner
from pa_ros.learning.progress import Progress
from pa_ros.networks.config import NetworkConfig
from pa_ros.world import Trajectory

CHANGING: dict[str, Any] = {
    "detectors__sparsity": 0.5,
    "relabeling__property_dropout": 0.5,
}


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

    def consume(self: Learner, trajectory: Trajectory) -> ConsumeReport:
        trajectories.append(trajectory)
        return original(self, trajectory)

    monkeypatch.setattr(Learner, "consume", consume)
    return trajectories


@pytest.mark.parametrize("lag", [0, 1, 3])
@pytest.mark.parametrize("steps", [1, 7, 20])
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


@pytest.mark.parametrize("lag", [1, 2])
def test_overlap_changes_nothing(tmp_path, monkeypatch, lag) -> None:
    settings = dpg(SETTINGS, schedule__policy_lag=lag, schedule__trajectory_steps=7)
    one = run(tmp_path / "a", 200, settings)
    monkeypatch.setattr(TrainConfig, "overlap", False)
    assert_same(one, run(tmp_path / "b", 200, settings))


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


@pytest.mark.parametrize(("field", "value"), [("design", "3-D"), ("preset", "paper")])
def test_another_runs_checkpoint_is_refused(tmp_path, field, value) -> None:
    run(tmp_path, 20)
    kept = (tmp_path / "progress.csv").read_bytes()
    with pytest.raises(CheckpointError, match=f"{field}: expected '{value}'"):
        run(tmp_path, 40, resume=True, **{field: value})
    assert (tmp_path / "progress.csv").read_bytes() == kept


def test_a_folder_that_another_run_writes_into_is_refused(tmp_path) -> None:
    with claim(tmp_path), pytest.raises(FolderTakenError, match="another run writes into"):
        run(tmp_path, 20)
    assert not (tmp_path / "progress.csv").exists()
    run(tmp_path, 20)


def test_settings_that_are_refused_leave_no_folder(tmp_path) -> None:
    with pytest.raises(ConfigError, match="device"):
        run(tmp_path / "run", 20, dpg(engine__device="meta"))
    assert not (tmp_path / "run").exists()


def test_where_no_file_has_locks_a_run_goes_on_without(tmp_path, monkeypatch) -> None:
    def no_locks(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", no_locks)
    run(tmp_path, 20)
    with pytest.raises(FolderTakenError):
        run(tmp_path, 20)
    with FolderLock(tmp_path):
        pass


def test_another_curve_is_refused(tmp_path) -> None:
    run(tmp_path, 60, evaluate_every_frames=20)
    curve = tmp_path / "progress.csv"
    curve.write_text(curve.read_text().replace("mean_q", "mean_z"))
    with pytest.raises(CheckpointError, match="mean_z.*got.*mean_q"):
        run(tmp_path, 120, resume=True, evaluate_every_frames=20)
    learned = read_metadata(tmp_path / "checkpoint")["counters"]["frames"]
    assert learned == 80  # what was learned until then is kept


@pytest.mark.parametrize("row", ["1", "1,x,3", "1,2,3,4"])
def test_a_curve_that_is_none_is_refused_before_anything_is_learned(tmp_path, row) -> None:
    (tmp_path / "progress.csv").write_text(f"frames,wall_s,updates\r\n{row}\r\n")
    with pytest.raises(CheckpointError, match="progress.csv"):
        Progress(tmp_path / "progress.csv", resume_frames=100)


@pytest.mark.parametrize("wall_s", ["abc", float("nan")])
def test_seconds_that_are_none_are_refused(tmp_path, wall_s) -> None:
    run(tmp_path, 20)
    metadata = find_checkpoint(tmp_path / "checkpoint") / "metadata.json"
    metadata.with_name("SHA256SUMS").unlink()
    values = json.loads(metadata.read_text())
    values["extra"]["wall_s"] = wall_s
    metadata.write_text(json.dumps(values))
    with pytest.raises(CheckpointError, match="wall_s: expected seconds, got"):
        run(tmp_path, 40, resume=True)


def test_a_folder_that_holds_a_run_is_resumed_or_refused(tmp_path) -> None:
    run(tmp_path, 60, evaluate_every_frames=20)
    kept = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(FolderTakenError, match=r"expected a folder without a run.*--resume"):
        run(tmp_path, 40, evaluate_every_frames=20)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == kept
    assert run(tmp_path, 80, resume=True).counters.frames == 80


def test_a_run_cut_off_before_its_first_checkpoint_starts_its_curve_anew(tmp_path) -> None:
    run(tmp_path, 60, evaluate_every_frames=20)
    shutil.rmtree(tmp_path / "checkpoint")
    run(tmp_path, 40, evaluate_every_frames=20)
    assert len((tmp_path / "progress.csv").read_text().splitlines()) == 3


def test_checkpoints_are_written_on_the_way(tmp_path, monkeypatch) -> None:
    versions: list[int] = []

    def save(root: Path, learner: Learner, extra: dict) -> Path:
        versions.append(learner.counters.version)
        return save_checkpoint(root, learner, extra)

    monkeypatch.setattr(records, "save_checkpoint", save)
    run(tmp_path, 200, checkpoint_every_frames=60)
    assert versions == [3, 6, 9, 10]
    directories = [p.name for p in (tmp_path / "checkpoint").iterdir()]
    assert sorted(directories) == ["LATEST", "version-000000009", "version-000000010"]


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


def without_room(monkeypatch, name: str, times: int, after: int = 0) -> None:
    """The disk is full for so many checkpoints, or rows of the curve, after some that had room."""
    kind: Any = {"save_checkpoint": records, "replace": Path}[name]
    original, left = getattr(kind, name), [after + times]

    def full(path: Path, *arguments: Any) -> Any:
        if name == "replace" and path.name != ".progress.part.csv":
            return original(path, *arguments)
        left[0] -= 1
        if 0 <= left[0] < times:
            raise CheckpointError("full") if kind is records else OSError(28, "full")
        return original(path, *arguments)

    monkeypatch.setattr(kind, name, full)


OFTEN: dict[str, Any] = {"evaluate_every_frames": 40, "checkpoint_every_frames": 60}


def test_a_full_disk_costs_checkpoints_on_the_way_and_not_the_run(
    tmp_path, monkeypatch, caplog
) -> None:
    unbroken = run(tmp_path / "a", 200, **OFTEN)
    without_room(monkeypatch, "save_checkpoint", 2)
    assert_same(unbroken, run(tmp_path / "b", 200, **OFTEN))
    said = [record.message for record in caplog.records if "full" in record.message]
    assert said == ["full: learning continues, and is saved when there is room"] * 2
    assert load_policy(tmp_path / "b/checkpoint").version == unbroken.counters.version


def test_what_can_not_be_saved_at_the_end_is_an_error(tmp_path, monkeypatch) -> None:
    without_room(monkeypatch, "save_checkpoint", 9)
    with pytest.raises(CheckpointError, match="full"):
        run(tmp_path, 200, **OFTEN)


def test_rows_that_had_no_room_are_written_with_the_next(tmp_path, monkeypatch, caplog) -> None:
    run(tmp_path / "a", 200, **OFTEN)
    (tmp_path / "b").mkdir()
    run(tmp_path / "b", 80, **OFTEN)
    without_room(monkeypatch, "replace", 1)
    kept = (tmp_path / "b/progress.csv").read_bytes()
    with pytest.raises(CheckpointError, match="progress.csv.*full"):
        run(tmp_path / "b", 200, resume=True, **OFTEN)
    assert (tmp_path / "b/progress.csv").read_bytes() == kept, "it was whole before"
    monkeypatch.undo()
    without_room(monkeypatch, "replace", 99, after=2)  # the run's begin, and its first row
    with pytest.raises(CheckpointError, match="progress.csv.*full"):
        run(tmp_path / "c", 120, **OFTEN)
    monkeypatch.undo()
    original = Progress.add

    def add(self: Progress, row: dict[str, float]) -> None:
        with monkeypatch.context() as patch:
            if row["frames"] == 120:
                without_room(patch, "replace", 1)
            original(self, row)

    monkeypatch.setattr(Progress, "add", add)
    run(tmp_path / "b", 200, resume=True, **OFTEN)
    assert "full" in caplog.text and "is written with the next row" in caplog.text

    def rows(name: str) -> list[str]:
        with (tmp_path / name / "progress.csv").open(newline="") as file:
            return [row["frames"] + row["critic_loss"] for row in csv.DictReader(file)]

    assert rows("a") == rows("b") and len(rows("a")) == 5


def test_an_error_of_the_learner_reaches_the_caller(tmp_path, monkeypatch) -> None:
    def consume(self: Learner, trajectory: Trajectory) -> ConsumeReport:
        raise ActingError("no")

    monkeypatch.setattr(Learner, "consume", consume)
    with pytest.raises(ActingError, match="no"):
        run(tmp_path, 200)


@pytest.mark.parametrize("field", ["seed", "frames", "evaluate_every_frames"])
def test_negative_numbers_are_refused(tmp_path, field) -> None:
    with pytest.raises(ConfigError, match="-1"):
        TrainConfig(out=tmp_path, **cast(dict[str, Any], {field: -1}))


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
