"""Experiments: when a seed counts as solved, resuming, and the table."""

import csv
import json
import math
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace

import pytest

from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.core.software import device
from pa_ros.evaluation.studies import experiments
from pa_ros.evaluation.studies.curves import read_curve
from pa_ros.evaluation.studies.experiments import (
    EXPERIMENTS,
    check_run,
    experiment_named,
    final_scores,
    headline,
    run_seed,
    summarize,
    under_protocol,
    write_table,
)
from pa_ros.evaluation.studies.failures import FailedError
from pa_ros.evaluation.studies.seeds import tabulate, train_seeds
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.loop import train


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


def test_labels_say_what_is_unusual():
    usual = experiment_named("programmable-2L")
    assert usual.label == "programmable-2L"
    paper = under_protocol(replace(usual, preset="paper", tag="k4"), "paper")
    assert paper.label == "programmable-2L.paper-protocol.paper-arm.k4"
    assert (paper.frames, under_protocol(usual, "ours")) == (2_000_000, usual)
    slow = replace(usual, preset="paper")
    assert under_protocol(slow, "ours").label == "programmable-2L.paper-arm"
    assert under_protocol(experiment_named("forgetting"), "paper").switch_frames == 2_500_000


SMALL = replace(
    experiment_named("programmable-2L"),
    frames=600,
    evaluate_every_frames=300,
    evaluation_episodes=2,
)


def test_a_table_says_on_what_machine_each_seed_was_trained(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("pa_ros.learning.run.here", lambda: "there")
    run_seed(SMALL, 0, tmp_path / "seed-0")
    monkeypatch.setattr("pa_ros.evaluation.studies.seeds.final_scores", lambda *_: (0.95, 0.97))
    made = tabulate(SMALL, [0, 1], tmp_path, tmp_path / "tables", tmp_path / "scores")
    assert made is not None and [seed.final_train for seed in made.summaries] == [0.97]
    setting = json.loads(made.table.with_suffix(".json").read_text())
    assert setting["seeds"] == [0] and setting["made_on"] == {"0": "there"}
    assert setting["device"] == device()


NOTHING = {"train_greedy.normalized": 0.0, "eval_greedy.normalized": 0.0}


def test_a_run_is_no_other_experiments_though_it_lies_where_that_would(tmp_path) -> None:
    """Else a table would say of it what it was not trained with."""
    folder = tmp_path / "seed-0"
    run_seed(SMALL, 0, folder, scores=lambda _: NOTHING)
    check_run(SMALL, 0, folder)
    check_run(replace(SMALL, frames=900), 0, folder)
    check_run(SMALL, 1, tmp_path / "seed-1")  # there is none as yet
    for other, said in (
        (replace(SMALL, options={"learner.detectors.gain": 5}), "gain: checkpoint 3.0, here 5.0"),
        (replace(SMALL, protocol="paper"), "differs in .*discount: checkpoint 0.95, here 0.99"),
        (replace(SMALL, algorithm="td3"), "algorithm: checkpoint 'dpg', here 'td3'"),
        (
            replace(SMALL, network="canonical"),
            "family: .*'programmable', here 'canonical'",
        ),
        (replace(SMALL, design="3-D"), "design: expected '3-D', got '2-L'"),
        (replace(SMALL, preset="paper"), "preset: expected 'paper', got 'fast'"),
        (replace(SMALL, frames=500, evaluate_every_frames=100), "500 frames, got 600"),
    ):
        with pytest.raises(CheckpointError, match=said):
            check_run(other, 0, folder)
    with pytest.raises(CheckpointError, match="seed: expected 1, got 0"):
        check_run(SMALL, 1, folder)
    with pytest.raises(CheckpointError, match="expected 900 frames, got 600"):
        check_run(replace(SMALL, frames=900), 0, folder, ended=True)


def test_the_command_states_no_run_under_settings_that_are_not_its_own(
    tmp_path, capsys, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    experiment = replace(
        experiment_named("programmable-2L"), frames=2500, options={"learner.detectors.gain": 2}
    )
    folder = tmp_path / "runs/experiments/programmable-2L.a/seed-0"
    run_seed(experiment, 0, folder, scores=lambda _: NOTHING)
    asked = ["experiment", "programmable-2L", "--seeds", "1", "--frames", "2500", "--tag", "a"]
    assert main([*asked, "--learner.detectors.gain=5"]) == 2
    assert "detectors.gain: checkpoint 2.0, here 5.0" in capsys.readouterr().err
    assert not (tmp_path / "runs/experiments/results").exists()
    folder = tmp_path / "runs/experiments/programmable-3D/seed-0"
    run_seed(replace(experiment, name="programmable-3D", design="3-D"), 0, folder,
             scores=lambda _: NOTHING)  # fmt: skip
    assert main(["experiment", "detectors", "--seeds", "1", "--frames", "2500"]) == 2
    assert "detectors.gain: checkpoint 2.0, here 3.0" in capsys.readouterr().err


def test_a_process_that_is_killed_is_one_line(tmp_path, monkeypatch) -> None:
    def killed(*_: object) -> None:
        raise BrokenProcessPool

    monkeypatch.setattr("concurrent.futures.Future.result", killed)
    with pytest.raises(FailedError, match="ended from outside"):
        train_seeds(replace(SMALL, frames=300), [0], tmp_path, jobs=1)


def test_an_interrupted_seed_goes_on_and_a_finished_one_is_not_run_again(tmp_path):
    run = tmp_path / "seed-0"
    curve = run_seed(SMALL, 0, run)
    first = read_curve(curve)
    longer = replace(SMALL, frames=1200)
    assert [row["frames"] for row in read_curve(run_seed(longer, 0, run))] == [
        300.0, 600.0, 900.0, 1200.0,
    ]  # fmt: skip
    stamp = curve.stat().st_mtime_ns
    run_seed(longer, 0, run)
    assert curve.stat().st_mtime_ns == stamp
    final = final_scores(run, tmp_path / "scores", episodes=2)
    assert all(-1.0 < score < 1.0 for score in final)
    summaries = [summarize(0, first, final), summarize(3, first)]
    assert math.isnan(summaries[1].final_held_out)
    table = write_table(tmp_path / "tables", SMALL, {0: first, 3: first}, summaries)
    with table.open(newline="") as file:
        written = list(csv.DictReader(file))
    assert [row["seed"] for row in written] == ["0", "0", "3", "3"]
    assert float(written[1]["frames"]) == 600
    setting = json.loads(table.with_suffix(".json").read_text())
    assert setting["seeds"] == [0, 3] and setting["learner"]["relabeling"]["rule"] == "all-goals"
    slow = replace(SMALL, preset="paper")
    write_table(tmp_path / "tables", slow, {3: first}, [summarize(3, rows(0.95))])
    other = replace(slow, protocol="paper")
    write_table(tmp_path / "tables", other, {4: first}, [summarize(4, first)])
    assert headline(tmp_path / "tables") == {
        "frames_to_solve.2-L.median": "inf", "solved.2-L": 0, "seeds.2-L": 2,
        "frames_to_solve.2-L.paper-arm.median": 1000.0,
        "solved.2-L.paper-arm": 1, "seeds.2-L.paper-arm": 1,
    }  # fmt: skip


def test_forgetting_trains_on_held_out_programs_after_the_switch(tmp_path, monkeypatch):
    told = []

    def spy(config, *rest, **options):
        told.append((config.condition, config.frames, options["resume"]))
        return train(config, *rest, **options)

    monkeypatch.setattr(experiments, "train", spy)
    options = EXPERIMENTS["forgetting"].options
    small = replace(SMALL, design="3-D", switch_frames=300, options=options)
    curve = run_seed(small, 0, tmp_path)
    assert told == [("train", 300, False), ("eval", 600, True)]
    assert [row["frames"] for row in read_curve(curve)] == [300.0, 600.0]
    run_seed(small, 0, tmp_path)
    assert len(told) == 2
    with pytest.raises(CheckpointError):
        read_curve(tmp_path / "absent.csv")


def test_a_final_score_decides_before_the_curve():
    assert not summarize(0, rows(0.95), (0.85, 0.9)).solved
    assert summarize(0, rows(0.85), (0.92, 0.9)).solved
