"""Checkpoints are plain files; a damaged one, or another learner's, is rejected with a reason."""

import errno
import json
import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from helpers.worlds import (
    NETWORK,
    PROGRAMS,
    SCORING,
    SETTINGS,
    WORDS,
    PointWorld,
    dpg,
    random_trajectory,
    run,
)
from pa_ros.acting.executing import Actor
from pa_ros.core.errors import ConfigError
from pa_ros.core.software import here
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.checkpoint_files import find_checkpoint, make_latest, newest_whole
from pa_ros.learning.checkpoints import load_policy, read_metadata, restore, save_checkpoint
from pa_ros.learning.errors import CheckpointError, DivergedError
from pa_ros.learning.folder import holds_checkpoint
from pa_ros.learning.learner import Learner
from pa_ros.networks.config import NetworkConfig
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World

FILES = ("metadata.json", "engine.safetensors", "replay.safetensors", "policies.safetensors")


def learner() -> Learner:
    return Learner(NETWORK, SETTINGS, PROGRAMS, 3, SCORING)


@pytest.fixture
def saved(tmp_path) -> Path:
    """Checkpoints of versions 4 and 5."""
    run(tmp_path / "run", 100, checkpoint_every_frames=80)
    return tmp_path / "run" / "checkpoint"


def edit(root: Path, **values: object) -> None:
    """Change metadata.json of the latest checkpoint; None deletes a value."""
    path = find_checkpoint(root) / "metadata.json"
    path.with_name("SHA256SUMS").unlink(missing_ok=True)
    changed = json.loads(path.read_text()) | values
    path.write_text(json.dumps({k: value for k, value in changed.items() if value is not None}))


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(bytes(content))


def test_a_checkpoint_is_plain_and_acts(saved) -> None:
    values = read_metadata(saved)
    assert values["counters"]["frames"] == 100
    assert values["extra"]["design"] == "2-L" and values["extra"]["seed"] == 3
    assert NetworkConfig.from_json(values["network"]) == NETWORK
    assert DPGConfig.from_json(values["learner"]) == SETTINGS
    observation, _ = PointWorld().reset(0)
    assert Actor.of(load_policy(saved)).act(observation, PROGRAMS[0]).shape == (6,)
    files = {p.suffix for p in find_checkpoint(saved).iterdir()}
    assert files == {".json", ".safetensors", ""}


def test_a_checkpoint_names_the_machines_that_its_run_used(saved, monkeypatch) -> None:
    extra = read_metadata(saved)["extra"]
    assert extra["made_on"] == here()
    edit(saved, extra=extra | {"made_on": "there"})
    monkeypatch.setattr("pa_ros.learning.run.here", lambda: "here")
    run(saved.parent, 120, resume=True)
    assert read_metadata(saved)["extra"]["made_on"] == "there; then here"
    run(saved.parent, 140, resume=True)
    assert read_metadata(saved)["extra"]["made_on"] == "there; then here"


@pytest.mark.parametrize(
    ("network", "settings", "message"),
    [
        (NETWORK.changed(hidden=7), SETTINGS, "hidden: checkpoint 6, here 7"),
        (NETWORK.changed(family="distilled-critic"), SETTINGS, "checkpoint 'programmable', here"),
        (
            NETWORK,
            dpg(SETTINGS, optimizer__critic_rate=1e-3),
            "critic_rate: checkpoint 0.0003, here",
        ),
    ],
)
def test_another_learners_checkpoint_is_rejected(saved, network, settings, message) -> None:
    with pytest.raises(CheckpointError, match=message):
        restore(saved, Learner(network, settings, PROGRAMS, 3, SCORING))


def test_of_another_world_the_part_that_differs_is_named(saved) -> None:
    network = NETWORK.changed(world=World(PAPER, WORDS, joints=7))
    with pytest.raises(CheckpointError) as refused:
        restore(saved, Learner(network, SETTINGS, PROGRAMS, 3, SCORING))
    assert str(refused.value).endswith(": differs in world.joints: checkpoint 6, here 7")


def test_an_agent_acts_whose_learning_settings_are_not_known_here(saved) -> None:
    metadata = find_checkpoint(saved) / "metadata.json"
    values = json.loads(metadata.read_text())
    network = json.loads(values["network"]) | {"later": 1}
    metadata.write_text(json.dumps(values | {"network": json.dumps(network)}))
    (find_checkpoint(saved) / "SHA256SUMS").unlink()
    assert load_policy(saved).version
    with pytest.raises(CheckpointError, match="agents can use its weights"):
        restore(saved, Learner(NETWORK, SETTINGS, PROGRAMS, 3, SCORING))


def test_a_learner_starts_from_the_networks_of_a_run_and_learns_anew(saved) -> None:
    theirs = learner()
    restore(saved, theirs)
    ours = Learner(NETWORK, SETTINGS.changed(starts_from=str(saved)), PROGRAMS, 4, SCORING)
    assert (ours.counters.frames, ours.replay.rows) == (0, 0)
    actor = theirs.snapshot().tensors
    assert all(np.array_equal(one, actor[key]) for key, one in ours.snapshot().tensors.items())
    trained, started = theirs.engine.tensors(), ours.engine.tensors()
    for name in ("critic.output.weight", "target_critic.output.weight"):
        np.testing.assert_array_equal(started[name], trained[name])
    assert not any(one.any() for name, one in started.items() if name.startswith("adam."))


def test_the_critic_of_an_agent_that_only_acts_knows_its_words(saved) -> None:
    (find_checkpoint(saved) / "engine.safetensors").unlink()
    started = Learner(NETWORK, SETTINGS.changed(starts_from=str(saved)), PROGRAMS, 4, SCORING)
    tensors = started.engine.tensors()
    known, value = "detectors.weight", "output.weight"
    np.testing.assert_array_equal(tensors[f"critic.{known}"], tensors[f"actor.{known}"])
    anew = Learner(NETWORK, SETTINGS, PROGRAMS, 4, SCORING).engine.tensors()
    np.testing.assert_array_equal(tensors[f"critic.{value}"], anew[f"critic.{value}"])


def test_a_new_critic_does_not_spoil_the_actor_that_a_learner_starts_from(saved, monkeypatch):
    monkeypatch.setattr("pa_ros.learning.learner.CRITIC_FIRST", 60)
    started = Learner(NETWORK, SETTINGS.changed(starts_from=str(saved)), PROGRAMS, 4, SCORING)
    rng, first = np.random.default_rng(0), started.engine.tensors()
    for sequence in range(6):
        started.consume(random_trajectory(rng, 20, sequence=sequence))
        newest, updates = started.engine.tensors(), started.counters.updates
        same = {name: np.array_equal(one, first[name]) for name, one in newest.items()}
        assert same["actor.output.weight"] == (updates < 60), updates
        assert same["critic.output.weight"] == (updates == 0), updates
    assert updates == 100


@pytest.mark.parametrize("other", ["shipped:3-D", "nowhere"])
def test_a_learner_does_not_start_from_other_networks(other) -> None:
    with pytest.raises(CheckpointError, match="expected"):
        Learner(NETWORK, SETTINGS.changed(starts_from=other), PROGRAMS, 3, SCORING)


def test_other_training_programs_are_rejected(saved) -> None:
    with pytest.raises(CheckpointError, match="expected programs"):
        restore(saved, Learner(NETWORK, SETTINGS, PROGRAMS[::-1], 3, SCORING))


def test_a_checkpoint_of_another_version_is_rejected_naming_both(tmp_path) -> None:
    (tmp_path / "metadata.json").write_text(json.dumps({"format": 2, "extra": {}}))
    with pytest.raises(CheckpointError, match=r"expected format 4 \(pa_ros .*\), got 2"):
        load_policy(tmp_path)


def test_the_checkpoint_of_a_runs_folder_is_found(saved) -> None:
    assert find_checkpoint(saved.parent) == find_checkpoint(saved)


def test_a_missing_checkpoint_is_an_error(tmp_path) -> None:
    with pytest.raises(CheckpointError, match="found none"):
        load_policy(tmp_path / "nowhere")
    with pytest.raises(CheckpointError, match="found none"):
        run(tmp_path / "nowhere", 20, resume=True)


def test_a_damaged_latest_costs_nothing(saved) -> None:
    (saved / "LATEST").write_bytes(b"\xff\xfe")
    (saved / "version-000000006").mkdir()  # nothing is in it
    with pytest.raises(CheckpointError, match="expected one at"):
        load_policy(saved)
    newest, damage = newest_whole(saved)
    assert newest.name == "version-000000005" and "LATEST: names no checkpoint" in damage
    assert "version-000000006, found none" in damage
    (saved / "LATEST").unlink()
    assert holds_checkpoint(saved.parent), "which is not begun anew"


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("damage", [flip, lambda path: path.write_bytes(b""), Path.unlink])
def test_a_damaged_checkpoint_costs_no_more_than_itself(saved, name, damage) -> None:
    damage(saved / "version-000000005" / name)
    with pytest.raises(CheckpointError):
        restore(saved, learner())
    whole, reason = newest_whole(saved)
    assert whole.name == "version-000000004" and "resumes from version-000000004" in reason
    again = learner()
    restore(whole, again)
    (saved / "damaged-version-000000005" / "of an earlier time").mkdir(parents=True)
    make_latest(whole)
    for sequence in (5, 6):
        again.consume(random_trajectory(np.random.default_rng(0), sequence=sequence))
    save_checkpoint(saved, again)
    kept = sorted(path.name for path in saved.iterdir() if path.is_dir())
    assert kept == ["damaged-version-000000005", "version-000000004", "version-000000006"]
    assert newest_whole(saved) == (saved / "version-000000006", "")


def test_foreign_files_and_folders_are_no_damage_and_stay(saved) -> None:
    newest = saved / "version-000000005"
    for name in (".DS_Store", "notes.txt", "old.safetensors"):
        (newest / name).write_text("mine")
    (newest / ".ipynb_checkpoints").mkdir()
    (newest / "link").symlink_to("nowhere")
    assert newest_whole(saved) == (newest, "")
    restore(saved, learner())


@pytest.mark.parametrize("number", [errno.EINVAL, errno.ENOTSUP])
def test_a_file_system_that_cannot_sync_a_folder_keeps_checkpoints(tmp_path, monkeypatch, number):
    def sync(descriptor: int) -> None:
        if os.path.isdir(f"/proc/self/fd/{descriptor}"):
            raise OSError(number, "cannot sync")

    monkeypatch.setattr(os, "fsync", sync)
    run(tmp_path / "run", 40)
    assert newest_whole(tmp_path / "run" / "checkpoint")[1] == ""


def test_all_content_is_on_the_disk_before_a_name_leads_to_it(tmp_path, monkeypatch) -> None:
    done, moves = list[str](), {"rename": os.rename, "replace": os.replace}

    def move(name: str, *paths: Path) -> None:
        done.append(name)
        moves[name](*paths)

    def sync(descriptor: int) -> None:
        assert os.fstat(descriptor).st_size, "nothing waits in a buffer"
        done.append(Path(os.readlink(f"/proc/self/fd/{descriptor}")).name)

    monkeypatch.setattr(os, "fsync", sync)
    for name in moves:
        monkeypatch.setattr(os, name, partial(move, name))
    save_checkpoint(tmp_path, learner())
    written = [*FILES, "SHA256SUMS", ".version-000000000"]
    assert done == [*written, "rename", tmp_path.name, ".LATEST", "replace", tmp_path.name]


def test_a_folder_that_cannot_be_written_ends_a_run_before_it_starts(tmp_path, monkeypatch) -> None:
    def fail(descriptor: int) -> None:
        raise OSError(errno.EIO, "bad disk")

    monkeypatch.setattr(os, "fsync", fail)
    monkeypatch.setattr(Learner, "consume", lambda *_: pytest.fail("it began to learn"))
    with pytest.raises(CheckpointError, match="bad disk"):
        run(tmp_path / "run", 40)
    monkeypatch.undo()
    run(tmp_path / "run", 40)  # and leaves nothing that is in the way


def test_acting_reads_no_replay_so_it_survives_a_damaged_one(saved) -> None:
    flip(find_checkpoint(saved) / "replay.safetensors")
    assert load_policy(saved).version == 5
    flip(find_checkpoint(saved) / "policies.safetensors")
    with pytest.raises(CheckpointError, match="policies.safetensors: expected SHA-256"):
        load_policy(saved)


def test_if_no_checkpoint_is_whole_each_damage_is_named(saved) -> None:
    for directory in saved.glob("version-*"):
        flip(directory / "engine.safetensors")
    with pytest.raises(CheckpointError, match="00005/engine.*expected SHA.*00004/engine.*expected"):
        newest_whole(saved)


def test_leftovers_of_a_kill_go_with_the_next_checkpoint_and_nothing_else(saved) -> None:
    (saved / ".version-000000004").mkdir()
    (saved / "version-notes.txt").write_text("mine")
    (saved / "version-000000001-copy").mkdir()
    save_checkpoint(saved, learner())
    names = {path.name for path in saved.iterdir()}
    assert ".version-000000004" not in names
    assert {"version-notes.txt", "version-000000001-copy"} <= names


@pytest.mark.parametrize("step", ["rename", "replace"])
def test_a_crash_while_writing_leaves_the_last_checkpoint(saved, monkeypatch, step) -> None:
    one = learner()
    restore(saved, one)
    one.consume(random_trajectory(np.random.default_rng(0), agent_id="other"))
    with monkeypatch.context() as patch:

        def crash(*_: object) -> None:
            raise OSError("the disk is full")

        patch.setattr(os, step, crash)
        with pytest.raises(CheckpointError, match="the disk is full"):
            save_checkpoint(saved, one)
    assert load_policy(saved).version == 5
    assert "6" not in "".join(path.name for path in saved.iterdir()), "it would fill the disk"
    save_checkpoint(saved, one)
    names = sorted(p.name for p in saved.iterdir())
    assert names == ["LATEST", "version-000000005", "version-000000006"]


@pytest.mark.parametrize(
    ("name", "value"), [("actor.output.bias", np.nan), ("adam.critic.v.output.bias", np.inf)]
)
def test_numbers_that_are_not_finite_are_never_saved(saved, name, value) -> None:
    one = learner()
    restore(saved, one)
    before = {path: path.read_bytes() for path in saved.rglob("*") if path.is_file()}
    tensors = one.engine.tensors()
    tensors[name].flat[0] = value  # one number is enough
    one.engine.load_tensors(tensors)
    one.counters.version += 1
    with pytest.raises(DivergedError, match=f"got others in 1 of .*{name}"):
        save_checkpoint(saved, one)
    assert {path: path.read_bytes() for path in saved.rglob("*") if path.is_file()} == before


def test_a_replay_buffer_is_longer_than_a_trajectory() -> None:
    dpg(replay__capacity_frames=21, schedule__trajectory_steps=20)
    with pytest.raises(ConfigError, match="capacity_frames: expected more than .* = 20, got 20"):
        dpg(replay__capacity_frames=20, schedule__trajectory_steps=20)
