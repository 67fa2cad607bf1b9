"""A checkpoint that is damaged anywhere is refused by type, or is none the worse."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

from helpers.damage import explore
from helpers.learners import ARENA, NETWORK, WORLD, trajectory
from pa_ros.core.errors import PaError
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.checkpoint_files import LATEST
from pa_ros.learning.checkpoints import load_policy, restore, save_checkpoint
from pa_ros.learning.learner import Learner

CHECKPOINTS = 20_000
FILES = ("metadata.json", "engine.safetensors", "replay.safetensors", "policies.safetensors")
SETTINGS = DPGConfig().changed(
    **{"replay.capacity_frames": 120, "replay.batch_size": 4, "replay.warmup_frames": 5}
)


def learner() -> Learner:
    network = NETWORK.changed(world=WORLD)
    return Learner(network, SETTINGS, ARENA.training_programs, 0)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The one checkpoint of a run."""
    taught = learner()
    taught.consume(trajectory(0))
    return save_checkpoint(tmp_path_factory.mktemp("whole"), taught)


def damages(sizes: dict[str, int]) -> st.SearchStrategy[tuple[str, int, bytes | None]]:
    """(file, where, what is written there; None: the file ends there)."""
    return st.sampled_from([*FILES, LATEST]).flatmap(
        lambda name: st.tuples(
            st.just(name),
            st.integers(0, max(sizes[name] - 1, 0)),
            st.one_of(st.none(), st.binary(min_size=1, max_size=8)),
        )
    )


@pytest.mark.timeout(0)
def test_checkpoints(whole: Path, tmp_path: Path):
    root, sizes = whole.parent, dict[str, int]()
    originals = {name: (whole / name).read_bytes() for name in FILES}
    originals[LATEST] = (root / LATEST).read_bytes()
    sizes = {name: len(content) for name, content in originals.items()}
    copy = tmp_path / "copy"
    shutil.copytree(root, copy)

    def check(case: tuple[str, int, bytes | None]) -> None:
        name, where, written = case
        before = originals[name]
        damaged = before[:where]
        if written is not None:
            damaged = (damaged + written + before[where + len(written) :])[: len(before)]
        path = copy / LATEST if name == LATEST else copy / whole.name / name
        path.write_bytes(damaged)
        try:
            judge(copy, damaged == before)
        finally:
            path.write_bytes(before)

    explore(damages(sizes), check, CHECKPOINTS)


def judge(root: Path, same: bool) -> None:
    """Refused by type; or restored, and then every number is what was saved."""
    taught: Any = learner()
    try:
        restore(root, taught)
    except PaError as error:
        assert not same, error
    else:
        good = learner()
        good.consume(trajectory(0))
        for name, tensor in good.engine.tensors().items():
            assert np.array_equal(tensor, taught.engine.tensors()[name]), name
    try:
        assert load_policy(root).version == 1
    except PaError as error:
        assert not same, error
