"""An experiment that was killed goes on from what is saved, whatever its curve says."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pa_ros.evaluation.scoring.agents import load_agent
from pa_ros.evaluation.studies.curves import CURVE, frames_done
from pa_ros.evaluation.studies.experiments import (
    EXPERIMENTS,
    check_run,
    experiment_named,
    run_seed,
    summarize,
    write_table,
)
from pa_ros.evaluation.studies.seeds import SeedsProgress
from pa_ros.learning import records
from pa_ros.learning.checkpoint_files import LATEST, METADATA
from pa_ros.learning.checkpoints import load_policy, read_metadata, save_checkpoint
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.folder import checkpoint_of

NOTHING = {"train_greedy.normalized": 0.0, "eval_greedy.normalized": 0.0}
LEARNS = {"learner.replay.warmup_frames": 100, "learner.replay.batch_size": 8}
SMALL = replace(
    experiment_named("programmable-2L"), frames=600, evaluate_every_frames=300, options=LEARNS
)
FORGETTING = replace(
    SMALL,
    design="3-D",
    switch_frames=300,
    options={**EXPERIMENTS["forgetting"].options, **LEARNS},
)


class Killed(BaseException):
    """As SIGKILL: nothing catches it."""


def go(folder: Path, experiment=SMALL) -> None:
    run_seed(experiment, 0, folder, scores=lambda _: NOTHING)


def frames_saved(folder: Path) -> int:
    return int(read_metadata(checkpoint_of(folder))["counters"]["frames"])


def weights(folder: Path):
    return load_policy(checkpoint_of(folder)).tensors


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folders = {e.design: tmp_path_factory.mktemp(e.design) for e in (SMALL, FORGETTING)}
    for experiment in (SMALL, FORGETTING):
        go(folders[experiment.design], experiment)
    return folders


@pytest.mark.parametrize(("experiment", "at"), [(SMALL, 600), (FORGETTING, 300)])
def test_killed_before_a_checkpoint_whose_row_is_written(
    experiment, at, tmp_path, monkeypatch, unbroken
):
    """The row of an evaluation is written before the checkpoint of the same frames."""

    def killed(root, learner, extra):
        if learner.counters.frames >= at:
            raise Killed
        return save_checkpoint(root, learner, extra)

    with monkeypatch.context() as dying:
        dying.setattr(records, "save_checkpoint", killed)
        with pytest.raises(Killed):
            go(tmp_path, experiment)
    assert frames_done(tmp_path / CURVE) == at > frames_saved(tmp_path)
    go(tmp_path, experiment)
    assert frames_saved(tmp_path) == frames_done(tmp_path / CURVE) == 600
    other = weights(unbroken[experiment.design])
    assert all(np.array_equal(tensor, other[name]) for name, tensor in weights(tmp_path).items())


def without_latest(root: Path) -> None:
    (root / LATEST).unlink()


def cut(root: Path) -> None:
    newest = sorted(root.glob("version-*"))[-1] / METADATA
    newest.write_bytes(newest.read_bytes()[:-20])


@pytest.mark.parametrize("harm", [without_latest, cut])
def test_a_seed_goes_on_from_what_resuming_a_run_would(
    harm: Callable[[Path], None], tmp_path, unbroken
):
    folder = tmp_path / "seed-0"
    shutil.copytree(unbroken["2-L"], folder)
    harm(checkpoint_of(folder))
    check_run(SMALL, 0, folder)
    go(folder)
    assert frames_saved(folder) == 600 and load_agent(folder).snapshot
    with pytest.raises(CheckpointError, match="seed: expected 1, got 0"):
        check_run(SMALL, 1, folder)


def test_killed_before_the_first_checkpoint_is_named(tmp_path, unbroken):
    """Its folder is complete, and is the one there is."""
    go(tmp_path, replace(SMALL, frames=300))
    root = checkpoint_of(tmp_path)
    for older in sorted(root.glob("version-*"))[:-1]:
        shutil.rmtree(older)
    without_latest(root)
    go(tmp_path)
    other = weights(unbroken["2-L"])
    assert all(np.array_equal(tensor, other[name]) for name, tensor in weights(tmp_path).items())


def test_a_seed_whose_checkpoints_are_all_damaged_is_refused_and_kept(tmp_path, unbroken):
    folder = tmp_path / "seed-0"
    shutil.copytree(unbroken["2-L"], folder)
    for metadata in checkpoint_of(folder).glob(f"version-*/{METADATA}"):
        metadata.write_text("{}")
    before = sorted(path.name for path in folder.rglob("*"))
    check_run(SMALL, 0, folder)  # of which nothing is known
    with pytest.raises(CheckpointError, match="damaged"):
        go(folder)
    assert sorted(path.name for path in folder.rglob("*")) == before


@pytest.mark.parametrize("text", ["a,b\n1,2\n", "frames\nx\n", "frames,wall_s\n1\n"])
def test_a_curve_that_is_none_stops_no_other_seed(text, tmp_path):
    (tmp_path / CURVE).write_text(text)
    with pytest.raises(CheckpointError, match=CURVE):
        frames_done(tmp_path / CURVE)
    with SeedsProgress(SMALL, [tmp_path]) as progress:
        progress.show()


def test_curves_of_other_columns_leave_the_table_that_is_there(tmp_path):
    row = {"frames": 300.0, "wall_s": 1.0, **NOTHING}
    summaries = [summarize(seed, [row]) for seed in (0, 1)]
    table = write_table(tmp_path, SMALL, {0: [row]}, summaries[:1])
    before = table.read_text()
    with pytest.raises(CheckpointError, match=r"seed 1.*expected columns .*wall_s"):
        write_table(tmp_path, SMALL, {0: [row], 1: [{**row, "mean_q": 1.0}]}, summaries)
    assert table.read_text() == before
