"""Variants of an experiment, cut to the frames that all have."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from laboratory.studies.experiments import EXPERIMENTS, Experiment, summarize, write_table
from laboratory.studies.results import write_algorithms, write_variants
from laboratory.studies.tables import EvaluationError, read_rows, read_setting, write_setting
from laboratory.studies.variants import Variant
from pa_ros.cli.main import main

BASE = EXPERIMENTS["programmable-2L"]


def table(
    results: Path,
    experiment: Experiment,
    scores: dict[int, list[float]],
    fresh: dict[int, float] | None = None,
) -> None:
    """Held-out scores by seed, one each 2,500 frames."""
    curves = {
        seed: [
            {
                "frames": 2500.0 * (i + 1),
                "wall_s": 2.0 * (i + 1),
                "train_greedy.normalized": 1.0,
                "eval_greedy.normalized": score,
            }
            for i, score in enumerate(values)
        ]
        for seed, values in scores.items()
    }
    fresh = fresh or {}
    summaries = [
        summarize(seed, rows, (fresh.get(seed, math.nan), 1.0)) for seed, rows in curves.items()
    ]
    write_table(results, experiment, curves, summaries)


def test_all_are_judged_where_the_shortest_curve_ends(tmp_path: Path) -> None:
    table(tmp_path, BASE, {0: [0.1, 0.95, 0.96, 0.2], 1: [0.92, 0.93, 0.94, 0.95]})
    changed = replace(BASE, tag="free", options={"learner.detectors.sparsity": 0})
    table(tmp_path, changed, {0: [0.1, 0.2, 0.5], 1: [0.1, 0.91, 0.93]})
    table(tmp_path, replace(BASE, preset="paper"), {0: [0.0]})  # another arm: no variant
    path = write_variants("programmable-2L", tmp_path)
    ours, free = read_rows(path, Variant)
    assert (ours.label, ours.changed, ours.frames) == ("programmable-2L", "", 7500)
    assert (ours.seeds, ours.solved, ours.frames_to_solve) == (2, 2, 3750)
    assert ours.wall_s_to_solve == 3.0 and ours.held_out == pytest.approx(0.95)
    assert (free.label, free.changed) == ("programmable-2L.free", "learner.detectors.sparsity=0")
    assert (free.solved, free.frames_to_solve) == (1, math.inf)
    assert free.low == pytest.approx(0.5) and free.high == pytest.approx(0.93)
    assert path.with_suffix(".png").stat().st_size > 5000


def test_a_seed_that_ends_there_is_judged_by_its_fresh_episodes(tmp_path: Path) -> None:
    table(tmp_path, BASE, {0: [0.1, 0.95, 0.2]}, {0: 0.2})
    changed = replace(BASE, tag="noise", options={"learner.detectors.sparsity": 0})
    table(tmp_path, changed, {0: [0.1, 0.87]}, {0: 0.95})
    ours, noise = read_rows(write_variants("programmable-2L", tmp_path), Variant)
    assert (ours.solved, noise.solved) == (1, 1)


def test_any_experiment_may_have_variants(tmp_path: Path, capsys) -> None:
    base = EXPERIMENTS["relations-3D"]
    table(tmp_path, base, {0: [0.1, 0.95]})
    assert main(["experiment", "variants", "--results", str(tmp_path)]) == 1
    assert "expected an experiment's tables with and without --tag" in capsys.readouterr().out
    table(tmp_path, replace(base, tag="a", options={"learner.detectors.sparsity": 0}), {0: [0.2]})
    assert main(["experiment", "variants", "--results", str(tmp_path)]) == 0
    assert (tmp_path / "relations-3D-variants.csv").exists()


def test_algorithms_are_compared_but_are_no_variants(tmp_path: Path) -> None:
    table(tmp_path, BASE, {0: [0.1, 0.95, 0.96]})
    table(tmp_path, replace(BASE, algorithm="td3"), {0: [0.1, 0.2, 0.93], 1: [0.1, 0.2, 0.94]})
    path = write_algorithms("programmable-2L", tmp_path)
    ours, other = read_rows(path, Variant)
    assert (ours.changed, ours.frames_to_solve) == ("dpg", 5000)
    assert (other.label, other.changed) == ("programmable-2L.td3", "td3")
    assert (other.seeds, other.solved, other.frames_to_solve) == (2, 2, 7500)
    with pytest.raises(EvaluationError, match="expected programmable-2L and a variant"):
        write_variants("programmable-2L", tmp_path)


def test_a_setting_is_read_if_it_says_what_is_needed(tmp_path) -> None:
    write_setting(tmp_path / "a.csv", {"design": "2-L"})
    assert read_setting(tmp_path / "a.csv", "design") == {"design": "2-L"}
    with pytest.raises(EvaluationError, match=r"expected JSON with \['arm'\], got \['design'\]"):
        read_setting(tmp_path / "a.csv", "arm")
    write_setting(tmp_path / "older.csv", {"protocol": "ours"})
    assert read_setting(tmp_path / "older.csv", "recipe") == {"recipe": "ours"}


@pytest.mark.parametrize("text", ["{", "[]"])
def test_a_damaged_setting_is_rejected(tmp_path, text, capsys) -> None:
    for experiment in (
        BASE,
        replace(BASE, tag="free", options={"learner.detectors.sparsity": 0.0}),
    ):
        table(tmp_path, experiment, {0: [0.1, 0.95]})
    (tmp_path / "programmable-2L.free.json").write_text(text)
    for command in (["experiment", "variants"], ["figures", "programmable-2L.free"]):
        assert main([*command, "--results", str(tmp_path)]) == 2
        error = capsys.readouterr().err
        assert "programmable-2L.free.json: " in error and error.count("\n") == 1
