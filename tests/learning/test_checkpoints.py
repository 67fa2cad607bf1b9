"""Checkpoints: plain files, refused by type when they are damaged or another learner's."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from helpers.worlds import (
    NETWORK,
    PROGRAMS,
    SCORING,
    SETTINGS,
    PointWorld,
    dpg,
    random_trajectory,
    run,
)
from pa_ros.acting.actor import Actor
from pa_ros.core.settings import read_json
from pa_ros.core.software import here
from pa_ros.learning import checkpoints
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.checkpoints import (
    find_checkpoint,
    load_policy,
    read_metadata,
    restore,
    save_checkpoint,
)
from pa_ros.learning.errors import CheckpointError, DivergedError
from pa_ros.learning.learner import Learner
from pa_ros.networks.config import NetworkConfig


@pytest.fixture
def saved(tmp_path) -> Path:
    run(tmp_path / "run", 100)
    return tmp_path / "run" / "checkpoint"


def test_a_policy_is_of_one_checkpoint_though_the_next_is_saved_meanwhile(saved, monkeypatch):
    read = read_json

    def read_while_learning(text: str) -> object:
        monkeypatch.undo()
        run(saved.parent, 120, resume=True)
        return read(text)

    monkeypatch.setattr(checkpoints, "read_json", read_while_learning)
    assert load_policy(saved).version == 5
    assert load_policy(saved).version == 6


@pytest.mark.parametrize(
    ("name", "acts"), [("replay.safetensors", True), ("policies.safetensors", False)]
)
def test_what_acts_reads_no_replay(saved, name, acts) -> None:
    path = find_checkpoint(saved) / name
    path.write_bytes(path.read_bytes()[:-1] + b"\x99")
    if acts:
        assert load_policy(saved).version == 5
    else:
        with pytest.raises(CheckpointError, match=f"{name}: expected SHA-256"):
            load_policy(saved)
    with pytest.raises(CheckpointError, match=f"{name}: expected SHA-256"):
        restore(saved, Learner(NETWORK, SETTINGS, PROGRAMS, 3, SCORING))


@pytest.fixture
def edited(saved) -> Path:
    """A checkpoint that may be edited: without checksums, as earlier versions wrote them."""
    (find_checkpoint(saved) / "SHA256SUMS").unlink()
    return saved


def test_a_checkpoint_is_plain_and_acts(saved) -> None:
    values = read_metadata(saved)
    assert values["counters"]["frames"] == 100
    assert values["extra"]["design"] == "2-L" and values["extra"]["seed"] == 3
    assert NetworkConfig.from_json(values["network"]) == NETWORK
    assert DPGConfig.from_json(values["learner"]) == SETTINGS
    snapshot = load_policy(saved)
    assert snapshot.version == 5
    actor = Actor.of(snapshot)
    observation, _ = PointWorld().reset(0)
    assert actor.act(observation, PROGRAMS[0]).shape == (6,)
    files = {p.suffix for p in find_checkpoint(saved).iterdir()}
    assert files == {".json", ".safetensors", ""}


@pytest.mark.parametrize(
    ("before", "after"),
    [("", "here"), ("there", "there; then here"), ("here; then there", "here; then there")],
)
def test_a_checkpoint_says_on_what_machines_its_run_was(edited, monkeypatch, before, after) -> None:
    path = find_checkpoint(edited) / "metadata.json"
    values = json.loads(path.read_text())
    assert values["extra"]["made_on"] == here()
    values["extra"]["made_on"] = before
    path.write_text(json.dumps(values))
    monkeypatch.setattr("pa_ros.learning.run.here", lambda: "here")
    run(edited.parent, 120, resume=True)
    assert read_metadata(edited)["extra"]["made_on"] == after


@pytest.mark.parametrize(
    ("network", "settings", "message"),
    [
        (NETWORK.changed(hidden=7), SETTINGS, "hidden: checkpoint 6, here 7"),
        (NETWORK.changed(kind="distilled-critic"), SETTINGS, "checkpoint 'programmable', here"),
        (
            NETWORK,
            dpg(SETTINGS, optimizer__critic_rate=1e-3),
            "critic_rate: checkpoint 0.0003, here",
        ),
    ],
)
def test_another_learners_checkpoint_is_refused(saved, network, settings, message) -> None:
    with pytest.raises(CheckpointError, match=message):
        restore(saved, Learner(network, settings, PROGRAMS, 3, SCORING))


def test_other_training_programs_are_refused(saved) -> None:
    with pytest.raises(CheckpointError, match="expected programs"):
        restore(saved, Learner(NETWORK, SETTINGS, PROGRAMS[::-1], 3, SCORING))


@pytest.mark.parametrize(
    "name", ["metadata.json", "engine.safetensors", "replay.safetensors", "policies.safetensors"]
)
@pytest.mark.parametrize("damage", ["missing", "truncated", "empty"])
def test_a_damaged_checkpoint_is_refused(edited, name, damage) -> None:
    path = find_checkpoint(edited) / name
    content = path.read_bytes()
    if damage == "missing":
        path.unlink()
    else:
        path.write_bytes(content[: len(content) // 2] if damage == "truncated" else b"")
    with pytest.raises(CheckpointError):
        restore(edited, Learner(NETWORK, SETTINGS, PROGRAMS, 3, SCORING))


@pytest.mark.parametrize("latest", [b"\xff\xfe", b"version\0", b"", b"../elsewhere", b"x" * 4000])
def test_an_edited_latest_is_refused(saved, latest) -> None:
    (saved / "LATEST").write_bytes(latest)
    with pytest.raises(CheckpointError, match="expected one at"):
        load_policy(saved)


@pytest.mark.parametrize("value", [None, 7, "x", [], {}, [1], {"x": 1}, [None], 1e300])
@pytest.mark.parametrize(
    "name", ["rng", "counters", "replay", "network", "learner", "published", "programs", "format"]
)
def test_metadata_that_was_edited_is_refused_by_type(edited, name, value) -> None:
    path = find_checkpoint(edited) / "metadata.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {name: value}))
    with pytest.raises(CheckpointError):
        restore(edited, Learner(NETWORK, SETTINGS, PROGRAMS, 3, SCORING))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("architecture", 3),
        ("architecture", None),
        ("counters", {"version": 5, "frames": -5}),
        ("counters", {"version": 5, "frames": 1e300}),
        ("counters", {"version": 5}),
        ("counters", [5]),
    ],
)
def test_what_acting_and_studies_read_is_checked_for_them_too(edited, name, value) -> None:
    path = find_checkpoint(edited) / "metadata.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {name: value}))
    with pytest.raises(CheckpointError):
        read_metadata(edited)


def test_edits_are_seen_by_all_who_read_metadata(saved) -> None:
    path = find_checkpoint(saved) / "metadata.json"
    path.write_text(path.read_text().replace('"counters"', '"counter"'))
    with pytest.raises(CheckpointError, match="metadata.json: expected SHA-256"):
        read_metadata(saved)


def test_a_file_without_its_checksum_is_damaged(saved) -> None:
    sums = find_checkpoint(saved) / "SHA256SUMS"
    sums.write_text(sums.read_text().splitlines(keepends=True)[0])
    with pytest.raises(CheckpointError, match=r"engine.safetensors: expected SHA-256"):
        restore(saved, Learner(NETWORK, SETTINGS, PROGRAMS, 3, SCORING))


def test_what_a_kill_left_goes_with_the_next_checkpoint_and_nothing_else(saved) -> None:
    (saved / ".version-000000004").mkdir()
    (saved / ".version-000000004" / "replay.safetensors").write_bytes(b"cut")
    (saved / "version-notes.txt").write_text("mine")
    (saved / "version-000000001-copy").mkdir()
    learner = Learner(NETWORK, SETTINGS, PROGRAMS, 3, SCORING)
    save_checkpoint(saved, learner)
    names = {path.name for path in saved.iterdir()}
    assert ".version-000000004" not in names
    assert {"version-notes.txt", "version-000000001-copy"} <= names


@pytest.mark.parametrize("value", [None, 7, "x", [1]])
def test_facts_that_were_edited_are_refused_by_type(edited, value) -> None:
    path = find_checkpoint(edited) / "metadata.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"extra": value}))
    with pytest.raises(CheckpointError, match="extra: expected facts by name, got"):
        load_policy(edited)
    with pytest.raises(CheckpointError, match="extra: expected facts by name, got"):
        run(edited.parent, 120, resume=True)


@pytest.mark.parametrize("missing", ["rng", "counters", "replay", "network", "published", "extra"])
def test_metadata_that_lacks_something_is_refused(edited, missing) -> None:
    path = find_checkpoint(edited) / "metadata.json"
    values = json.loads(path.read_text())
    del values[missing]
    path.write_text(json.dumps(values))
    with pytest.raises(CheckpointError):
        restore(edited, Learner(NETWORK, SETTINGS, PROGRAMS, 3, SCORING))


def test_no_checkpoint_and_another_format(edited, tmp_path) -> None:
    with pytest.raises(CheckpointError, match="found none"):
        load_policy(tmp_path / "nowhere")
    with pytest.raises(CheckpointError, match="found none"):
        run(tmp_path / "nowhere", 20, resume=True)


def test_a_checkpoint_of_another_version_is_rejected_naming_both(tmp_path) -> None:
    (tmp_path / "metadata.json").write_text(json.dumps({"format": 2, "extra": {}}))
    with pytest.raises(CheckpointError, match=r"expected format 3 \(pa_ros .*\), got 2"):
        load_policy(tmp_path)


def test_a_crash_while_writing_leaves_the_last_checkpoint(saved, monkeypatch) -> None:

    learner = Learner(NETWORK, SETTINGS, PROGRAMS, 3, SCORING)
    restore(saved, learner)
    before = load_policy(saved)
    learner.consume(random_trajectory(np.random.default_rng(0), agent_id="other"))
    for step in ("rename", "replace"):
        with monkeypatch.context() as patch:

            def crash(*_: object) -> None:
                raise OSError("the disk is full")

            patch.setattr(os, step, crash)
            with pytest.raises(CheckpointError, match="the disk is full"):
                save_checkpoint(saved, learner)
        assert load_policy(saved).version == before.version
        assert "6" not in "".join(path.name for path in saved.iterdir()), "it would fill the disk"
    save_checkpoint(saved, learner)
    assert load_policy(saved).version == before.version + 1
    assert sorted(p.name for p in saved.iterdir()) == [
        "LATEST",
        "version-000000005",
        "version-000000006",
    ]


@pytest.mark.parametrize("name", ["actor.output.bias", "target_critic.output.bias",
                                  "adam.critic.v.output.bias"])  # fmt: skip
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_checkpoint_is_never_written_of_numbers_that_are_not_finite(saved, name, value) -> None:
    learner = Learner(NETWORK, SETTINGS, PROGRAMS, 3, SCORING)
    restore(saved, learner)
    before = {path: path.read_bytes() for path in saved.rglob("*") if path.is_file()}
    tensors = learner.engine.tensors()
    tensors[name][...] = value
    learner.engine.load_tensors(tensors)
    learner.counters.version += 1
    with pytest.raises(DivergedError, match=f"got others in 1 of .*{name}"):
        save_checkpoint(saved, learner)
    assert {path: path.read_bytes() for path in saved.rglob("*") if path.is_file()} == before
