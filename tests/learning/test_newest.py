"""A run goes on from its newest whole checkpoint: damage costs one of them at most, and is said."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from helpers.learners import ARENA, NETWORK, WORLD, trajectory
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.checkpoints import LATEST, restore, save_checkpoint
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.learner import Learner
from pa_ros.learning.newest import make_latest, newest_whole

FILES = ("metadata.json", "engine.safetensors", "replay.safetensors", "policies.safetensors")


def learner() -> Learner:
    network = NETWORK.changed(world=WORLD)
    return Learner(network, DPGConfig(), ARENA.training_programs, 0)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Checkpoints of versions 1 and 2."""
    taught = learner()
    for sequence in range(2):
        taught.consume(trajectory(sequence))
        save_checkpoint(tmp_path, taught)
    return tmp_path


def newest(root: Path) -> Path:
    return sorted(root.glob("version-*"))[-1]


def flip(path: Path, at: int = -1) -> None:
    content = bytearray(path.read_bytes())
    content[at] ^= 1
    path.write_bytes(bytes(content))


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize(
    "damage", [flip, lambda p: p.write_bytes(p.read_bytes()[:-9]), Path.unlink]
)
def test_a_damaged_checkpoint_costs_no_more_than_itself(root, name, damage):
    damage(newest(root) / name)
    with pytest.raises(CheckpointError):
        restore(root, learner())
    whole, passed_over = newest_whole(root)
    assert whole.name == "version-000000001" and "goes on from version-000000001" in passed_over
    if damage is flip:
        assert f"{name}: expected SHA-256 " in passed_over
    again = learner()
    restore(whole, again)
    make_latest(whole)
    for sequence in (5, 6):
        again.consume(trajectory(sequence))
    assert save_checkpoint(root, again).name == newest(root).name == "version-000000003"
    assert newest_whole(root) == (newest(root), "")
    kept = sorted(path.name for path in root.iterdir() if path.is_dir())
    assert kept == ["damaged-version-000000002", "version-000000001", "version-000000003"]


def test_without_damage_it_is_the_newest(root):
    assert newest_whole(root) == (newest(root), "")
    (newest(root) / "SHA256SUMS").unlink()  # of a version that wrote none
    assert newest_whole(root) == (newest(root), "")


def test_a_damaged_latest_costs_nothing(root):
    (root / LATEST).write_bytes(b"\0\0")
    whole, passed_over = newest_whole(root)
    assert whole == newest(root) and "LATEST: names no checkpoint" in passed_over


def test_none_that_is_whole_is_refused_with_each_damage(root):
    for directory in root.glob("version-*"):
        flip(directory / "engine.safetensors")
    with pytest.raises(CheckpointError, match="00002/engine.*expected SHA.*00001/engine.*expected"):
        newest_whole(root)
    with pytest.raises(CheckpointError, match="found none"):
        newest_whole(root / "elsewhere")


def test_sha256sum_checks_it_too(root):
    command = ["sha256sum", "--check", "--strict", "--quiet", "SHA256SUMS"]
    assert subprocess.run(command, cwd=newest(root)).returncode == 0
    flip(newest(root) / "metadata.json")
    assert subprocess.run(command, cwd=newest(root)).returncode == 1
