"""A bag or a checkpoint that is damaged anywhere is read, repaired or rejected by a PaError."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

from helpers.damage import explore
from helpers.learners import ARENA, NETWORK, WORLD, trajectory
from helpers.recordings import train
from pa_ros.bags.errors import BagError
from pa_ros.bags.reader import Bag
from pa_ros.bags.repair import repair
from pa_ros.bags.summary import describe
from pa_ros.core.errors import PaError
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.checkpoint_files import LATEST
from pa_ros.learning.checkpoints import load_policy, restore, save_checkpoint
from pa_ros.learning.learner import Learner

BAGS, CHECKPOINTS = 5_000, 20_000
SETTINGS = DPGConfig().changed(
    **{"replay.capacity_frames": 120, "replay.batch_size": 4, "replay.warmup_frames": 5}
)
# Where (share of the file, in millionths), and what is written there; None: the file ends there.
Damage = tuple[int, bytes | None]
damages: st.SearchStrategy[Damage] = st.tuples(
    st.integers(0, 10**6 - 1), st.none() | st.binary(min_size=1, max_size=16)
)


def damage(path: Path, where: int, written: bytes | None) -> None:
    content = path.read_bytes()
    at = where * len(content) // 10**6
    rest = b"" if written is None else written + content[at + len(written) :]
    path.write_bytes(content[:at] + rest)


@pytest.mark.timeout(0)
def test_bags(tmp_path: Path):
    original, copy = tmp_path / "original", tmp_path / "copy"
    assert train(tmp_path / "run", "--record", original, frames=100) == 0
    suffixes = st.sampled_from([".mcap", ".mcap", ".mcap", ".yaml"])

    def check(case: list[tuple[str, Damage]]) -> None:
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(original, copy)
        for suffix, one in case:
            (path,) = [file for file in copy.iterdir() if file.suffix == suffix]
            damage(path, *one)
        read_bag(copy)
        try:
            repair(copy)
        except PaError:
            return
        read_bag(copy)

    explore(st.lists(st.tuples(suffixes, damages), min_size=1, max_size=3), check, BAGS)


def read_bag(bag: Path) -> None:
    """Read all that a bag contains; a PaError is a fine answer."""
    try:
        with Bag(bag) as opened:
            for recorded in opened.messages():
                try:
                    opened.deserialize(recorded)
                except BagError:
                    continue
        with Bag(bag) as opened:
            describe(opened)
    except PaError as error:
        assert str(error)


def new_learner() -> Any:
    return Learner(NETWORK.changed(world=WORLD), SETTINGS, ARENA.training_programs, 0)


@pytest.mark.timeout(0)
def test_checkpoints(tmp_path: Path):
    learner = new_learner()
    learner.consume(trajectory(0))
    folder = save_checkpoint(tmp_path, learner)
    paths = [tmp_path / LATEST, *folder.iterdir()]
    saved = learner.engine.tensors()

    def check(case: tuple[Path, Damage]) -> None:
        path, one = case
        before = path.read_bytes()
        damage(path, *one)
        try:
            load(same=path.read_bytes() == before)
        finally:
            path.write_bytes(before)

    def load(same: bool) -> None:
        """A damaged checkpoint is rejected, or every number is what was saved."""
        restored = new_learner()
        try:
            restore(tmp_path, restored)
            for name, tensor in restored.engine.tensors().items():
                assert np.array_equal(tensor, saved[name]), name
        except PaError as error:
            assert not same, error
        try:
            assert load_policy(tmp_path).version == 1
        except PaError as error:
            assert not same, error

    explore(st.tuples(st.sampled_from(paths), damages), check, CHECKPOINTS)
