"""Experiments: when a seed counts as solved, continuing, and the tables."""

import json
import math
import shutil
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from laboratory.studies import experiments
from laboratory.studies.experiments import (
    ABLATIONS,
    EXPERIMENTS,
    check_run,
    final_scores,
    run_seed,
    summarize,
    under_recipe,
)
from laboratory.studies.seeds import tabulate, train_seeds
from laboratory.studies.tables import CURVE, EvaluationError, frames_done, read_curve, read_curves
from pa_ros.agents import train_agent
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.core.software import device
from pa_ros.learning import records
from pa_ros.learning.checkpoint_files import LATEST, METADATA
from pa_ros.learning.checkpoints import load_policy, read_metadata, save_checkpoint
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.folder import checkpoint_of

NOTHING = {"train_greedy.normalized": 0.0, "eval_greedy.normalized": 0.0}
LEARNS = {"learner.replay.warmup_frames": 100, "learner.replay.batch_size": 8}
SMALL = replace(
    EXPERIMENTS["programmable-2L"],
    frames=600,
    evaluate_every_frames=300,
    evaluation_episodes=2,
    options=LEARNS,
)
FORGETTING = replace(
    SMALL, design="3-D", switch_frames=300, options={**EXPERIMENTS["forgetting"].options, **LEARNS}
)


def rows(*scores: float, column: str = "eval_greedy.normalized"):
    return [
        {"frames": 1000.0 * i, "wall_s": float(i), column: score, "train_greedy.normalized": score}
        for i, score in enumerate(scores, start=1)
    ]


def test_a_seed_is_solved_from_where_the_score_stays_above_the_bound():
    summary = summarize(7, rows(0.1, 0.95, 0.5, 0.92, 0.97))
    assert (summary.seed, summary.solved) == (7, True)
    assert (summary.frames_to_solve, summary.wall_s_to_solve) == (4000.0, 4.0)
    fell = summarize(0, rows(0.95, 0.95, 0.89))
    assert not fell.solved and math.isnan(fell.frames_to_solve)
    # A design without held-out programs is judged in training.
    assert summarize(0, rows(0.2, 0.91, column="train_greedy.normalized")).frames_to_solve == 2000.0


def test_a_score_on_fresh_episodes_counts_more_than_the_curve():
    assert not summarize(0, rows(0.95), (0.85, 0.9)).solved
    assert summarize(0, rows(0.85), (0.92, 0.9)).solved


def test_labels_name_what_differs_from_the_defaults():
    usual = EXPERIMENTS["programmable-2L"]
    assert usual.label == "programmable-2L"
    paper = under_recipe(replace(usual, preset="paper", tag="k4"), "paper")
    assert paper.label == "programmable-2L.paper-recipe.paper-arm.k4"
    assert (paper.frames, under_recipe(usual, "ours").label) == (2_000_000, usual.label)
    arms = {arm: replace(usual, arm=arm).label for arm in ("jaco", "panda")}
    assert arms == {"jaco": usual.label, "panda": "programmable-2L.panda"}
    assert EXPERIMENTS["zones-8"].label == "zones-8"  # whose own arm is not the jaco
    assert under_recipe(EXPERIMENTS["forgetting"], "paper").switch_frames == 2_500_000
    with pytest.raises(ConfigError, match="got 10"):
        replace(usual, frames=10)


def test_experiments_that_move_blocks_are_judged_by_success_and_named_by_what_differs() -> None:
    usual = EXPERIMENTS["push-2"]
    assert (usual.label, usual.score) == ("push-2", "success_rate")
    assert replace(usual, preset="push-slow").label == "push-2.push-slow-arm"
    assert EXPERIMENTS["push-2-sides"].task.vocabulary.relations[1] == "LEFT_OF"
    rows = [{"frames": 1e4, "wall_s": 9.0, "eval_greedy.success_rate": 0.95,
             "train_greedy.success_rate": 0.97}]  # fmt: skip
    assert summarize(0, rows, score=usual.score).frames_to_solve == 1e4
    stacking = EXPERIMENTS["stack-2"]
    for tag, options in ABLATIONS.items():
        assert replace(stacking, tag=tag, options=options).settings != stacking.settings


def go(folder: Path, experiment=SMALL) -> None:
    run_seed(experiment, 0, folder, scores=lambda _: NOTHING)


def frames_saved(folder: Path) -> int:
    return int(read_metadata(checkpoint_of(folder))["counters"]["frames"])


def weights(folder: Path):
    return load_policy(checkpoint_of(folder)).tensors


def same_weights(one: Path, other: Path) -> bool:
    expected = weights(other)
    return all(np.array_equal(tensor, expected[name]) for name, tensor in weights(one).items())


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Runs without interruption, by design."""
    folders = {e.design: tmp_path_factory.mktemp(e.design) for e in (SMALL, FORGETTING)}
    for experiment in (SMALL, FORGETTING):
        go(folders[experiment.design], experiment)
    return folders


def test_a_table_says_on_what_machine_each_seed_was_trained(tmp_path, unbroken, monkeypatch):
    monkeypatch.setattr("laboratory.studies.seeds.final_scores", lambda *_: (0.95, 0.97))
    shutil.copytree(unbroken["2-L"], tmp_path / "seed-0")
    shutil.copytree(unbroken["2-L"], tmp_path / "seed-2")
    shutil.rmtree(tmp_path / "seed-2" / "checkpoint")  # interrupted before its first one
    made = tabulate(SMALL, [0, 1, 2], tmp_path, tmp_path / "tables", tmp_path / "scores")
    assert made is not None
    table, (summary, begun) = made
    assert (summary.seed, summary.final_train) == (0, 0.97)
    assert begun.seed == 2 and math.isnan(begun.final_train)
    setting = json.loads(table.with_suffix(".json").read_text())
    assert setting["seeds"] == [0, 2] and list(setting["made_on"]) == ["0"]
    assert setting["device"] == device()
    assert setting["learner"]["relabeling"]["rule"] == "all-goals"
    assert [row["frames"] for row in read_curves(table)[0]] == [300.0, 600.0]


def test_a_run_of_another_setting_is_rejected(tmp_path, unbroken) -> None:
    folder = unbroken["2-L"]
    check_run(SMALL, 0, folder)
    check_run(replace(SMALL, frames=900), 0, folder)
    check_run(SMALL, 1, tmp_path / "absent")
    for other, reason in (
        (replace(SMALL, options={**LEARNS, "learner.detectors.gain": 5}), "gain: .*3.0, here 5.0"),
        (replace(SMALL, recipe="paper"), "discount: checkpoint 0.95, here 0.99"),
        (replace(SMALL, algorithm="td3"), "algorithm: checkpoint 'dpg', here 'td3'"),
        (replace(SMALL, network="canonical"), "family: .*'programmable', here 'canonical'"),
        (replace(SMALL, design="3-D"), "design: expected '3-D', got '2-L'"),
        (replace(SMALL, preset="paper"), "preset: expected 'paper', got 'fast'"),
        (replace(SMALL, frames=500, evaluate_every_frames=100), "500 frames, got 600"),
    ):
        with pytest.raises(CheckpointError, match=reason):
            check_run(other, 0, folder)
    with pytest.raises(CheckpointError, match="seed: expected 1, got 0"):
        check_run(SMALL, 1, folder)
    with pytest.raises(CheckpointError, match="expected 900 frames, got 600"):
        check_run(replace(SMALL, frames=900), 0, folder, ended=True)


def test_the_command_rejects_a_run_of_another_setting(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    experiment = replace(
        EXPERIMENTS["programmable-2L"], frames=2500, options={"learner.detectors.gain": 2}
    )
    go(tmp_path / "runs/experiments/programmable-2L.a/seed-0", experiment)
    asked = ["experiment", "programmable-2L", "--seeds", "1", "--frames", "2500", "--tag", "a"]
    assert main([*asked, "--learner.detectors.gain=5"]) == 2
    assert "detectors.gain: checkpoint 2.0, here 5.0" in capsys.readouterr().err
    assert not (tmp_path / "runs/experiments/results").exists()


def test_a_killed_training_process_is_an_error_that_says_how_to_continue(tmp_path, monkeypatch):
    def killed(*_: object) -> None:
        raise BrokenProcessPool

    monkeypatch.setattr("concurrent.futures.Future.result", killed)
    with pytest.raises(EvaluationError, match="run the same command again"):
        train_seeds(replace(SMALL, frames=300), [0], tmp_path, jobs=1)


def test_a_longer_experiment_continues_and_a_finished_one_is_not_trained_again(tmp_path, unbroken):
    run = tmp_path / "seed-0"
    shutil.copytree(unbroken["2-L"], run)
    longer = replace(SMALL, frames=900)
    go(run, longer)
    curve = run / CURVE
    assert [row["frames"] for row in read_curve(curve)] == [300.0, 600.0, 900.0]
    stamp = curve.stat().st_mtime_ns
    go(run, longer)
    assert curve.stat().st_mtime_ns == stamp
    assert all(-1.0 < score < 1.0 for score in final_scores(run, tmp_path / "scores", episodes=2))
    scored = [path.read_text().splitlines() for path in (tmp_path / "scores").rglob("*.csv")]
    assert [len(lines) - 1 for lines in scored] == [2] * 6  # agent and references, two conditions


@pytest.mark.parametrize(("until", "frames"), [(None, 600), (300, 300), (900, 600)])
def test_a_part_of_a_seed_ends_where_it_is_asked_to(tmp_path, monkeypatch, until, frames) -> None:
    asked = []
    monkeypatch.setattr(
        experiments, "train_agent", lambda *given, **_: asked.append(given[3].frames)
    )
    run_seed(SMALL, 0, tmp_path, until)
    assert asked == [frames]


class Killed(BaseException):
    """Like SIGKILL: nothing catches it."""


@pytest.mark.parametrize(("experiment", "at"), [(SMALL, 600), (FORGETTING, 300)])
def test_a_run_killed_between_its_curve_and_its_checkpoint_ends_with_the_same_weights(
    experiment, at, tmp_path, monkeypatch, unbroken
):
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
    assert same_weights(tmp_path, unbroken[experiment.design])


def remove_latest(root: Path) -> None:
    (root / LATEST).unlink()


def damage_newest(root: Path) -> None:
    newest = sorted(root.glob("version-*"))[-1] / METADATA
    newest.write_bytes(newest.read_bytes()[:-20])


@pytest.mark.parametrize("harm", [remove_latest, damage_newest])
def test_a_seed_continues_from_its_newest_undamaged_checkpoint(harm, tmp_path, unbroken):
    shutil.copytree(unbroken["2-L"], tmp_path, dirs_exist_ok=True)
    harm(checkpoint_of(tmp_path))
    go(tmp_path)
    assert frames_saved(tmp_path) == 600 and same_weights(tmp_path, unbroken["2-L"])


def test_a_seed_whose_checkpoints_are_all_damaged_is_rejected_and_kept(tmp_path, unbroken):
    folder = tmp_path / "seed-0"
    shutil.copytree(unbroken["2-L"], folder)
    for metadata in checkpoint_of(folder).glob(f"version-*/{METADATA}"):
        metadata.write_text("{}")
    before = sorted(path.name for path in folder.rglob("*"))
    with pytest.raises(CheckpointError, match="damaged"):
        go(folder)
    assert sorted(path.name for path in folder.rglob("*")) == before


def test_forgetting_trains_on_the_held_out_programs_after_the_switch(tmp_path, monkeypatch):
    trained = []

    def record(*given, **options):
        trained.append((given[3].condition, given[3].frames, options["resume"]))
        return train_agent(*given, **options)

    monkeypatch.setattr(experiments, "train_agent", record)
    go(tmp_path, FORGETTING)
    assert trained == [("train", 300, False), ("eval", 600, True)]


@pytest.mark.parametrize("text", ["a,b\n1,2\n", "frames\nx\n", "frames,wall_s\n1\n"])
def test_a_damaged_curve_is_rejected(text, tmp_path):
    (tmp_path / CURVE).write_text(text)
    with pytest.raises(EvaluationError, match=CURVE):
        frames_done(tmp_path / CURVE)
