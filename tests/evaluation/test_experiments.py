"""Experiments: when a seed counts as solved, resuming, and the table."""

import csv
import json
from dataclasses import replace

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.evaluation.experiments import (
    EXPERIMENTS,
    experiment_named,
    read_curve,
    run_seed,
    summarize,
    write_table,
)


def rows(*scores: float, column: str = "eval_greedy.normalized"):
    return [
        {"frames": 1000.0 * i, "wall_s": float(i), column: score, "train_greedy.normalized": score}
        for i, score in enumerate(scores, start=1)
    ]


def test_solved_is_the_first_time_that_lasts():
    summary = summarize(7, rows(0.1, 0.95, 0.5, 0.92, 0.97))
    assert (summary.seed, summary.solved) == (7, True)
    assert (summary.frames_to_solve, summary.wall_s_to_solve) == (4000.0, 4.0)


def test_a_seed_that_falls_back_is_not_solved():
    summary = summarize(0, rows(0.95, 0.95, 0.89))
    assert not summary.solved
    assert summary.frames_to_solve != summary.frames_to_solve  # NaN


def test_without_held_out_programs_training_decides():
    assert summarize(0, rows(0.2, 0.91, column="train_greedy.normalized")).frames_to_solve == 2000.0


def test_every_experiment_names_things_that_exist():
    for experiment in EXPERIMENTS.values():
        assert experiment.frames >= experiment.evaluate_every_frames
    with pytest.raises(ConfigError, match="programmable-2L"):
        experiment_named("programmable-9Z")
    with pytest.raises(ConfigError, match="got 10"):
        replace(experiment_named("programmable-2L"), frames=10)


def test_an_interrupted_seed_goes_on_and_a_finished_one_is_not_run_again(tmp_path):
    small = replace(
        experiment_named("programmable-2L"),
        frames=600,
        evaluate_every_frames=300,
        evaluation_episodes=2,
    )
    curve = run_seed(small, 0, tmp_path / "seed-0")
    first = read_curve(curve)
    longer = replace(small, frames=1200)
    assert [row["frames"] for row in read_curve(run_seed(longer, 0, tmp_path / "seed-0"))] == [
        300.0, 600.0, 900.0, 1200.0,
    ]  # fmt: skip
    stamp = curve.stat().st_mtime_ns
    run_seed(longer, 0, tmp_path / "seed-0")
    assert curve.stat().st_mtime_ns == stamp
    table = tmp_path / "table.csv"
    write_table(table, small, {0: first, 3: first})
    with table.open(newline="") as file:
        written = list(csv.DictReader(file))
    assert [row["seed"] for row in written] == ["0", "0", "3", "3"]
    assert float(written[1]["frames"]) == 600
    setting = json.loads(table.with_suffix(".json").read_text())
    assert setting["seeds"] == [0, 3] and setting["learner"]["relabel"] == "all-goals"
