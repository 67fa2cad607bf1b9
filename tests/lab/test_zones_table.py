"""The table of zones: scored once for each seed, and shown with what a straight line does."""

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

from laboratory.studies import zones
from laboratory.studies.experiments import EXPERIMENTS
from laboratory.studies.tables import read_rows, write_rows
from laboratory.studies.zones import CONDITIONS, TracesRow, write_traces
from pa_ros.arena import ReachTask
from pa_ros.arena.conditions import condition_named
from pa_ros.core.experience import Float64, Observation
from pa_ros.evaluation import traces
from pa_ros.evaluation.evaluate import reference_policy

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
import results_tables  # noqa: E402  (a script beside the docs)


def test_an_experiment_with_zones_has_their_arm_and_recipe_and_no_part_in_its_name() -> None:
    for name in ("zones-8", "zones-16"):
        experiment = EXPERIMENTS[name]
        assert experiment.label == name and experiment.arena.arm == "panda-wide"
        assert experiment.settings.learner.relabeling.rule == "entries"
        assert all(condition_named(one, experiment.task) for one in CONDITIONS)
    assert EXPERIMENTS["push-2"].arena.arm == "jaco"


def test_seeds_that_were_scored_are_not_scored_again(tmp_path, monkeypatch) -> None:
    experiment, loaded = EXPERIMENTS["zones-8"], []

    def load(run: Path) -> SimpleNamespace:
        loaded.append(run.name)
        return SimpleNamespace(arena=experiment.arena, design=experiment.task, policy="scripted")

    monkeypatch.setattr(zones, "load_agent", load)
    monkeypatch.setattr(zones, "CONDITIONS", ("reach", "blocked"))
    table = tmp_path / "zones-8-traces.csv"
    write_traces(table, {4: tmp_path / "four"}, episodes=2)
    write_traces(table, {3: tmp_path / "three", 4: tmp_path / "four"}, episodes=2)
    assert loaded == ["four", "three"]
    rows = read_rows(table, TracesRow)
    assert [(row.seed, row.condition) for row in rows] == [
        (4, "reach"), (4, "blocked"), (3, "reach"), (3, "blocked")
    ]  # fmt: skip
    assert rows[0].success_rate == rows[0].straight_line_rate == 1.0
    monkeypatch.setattr(zones, "CONDITIONS", ("reach", "blocked", "non-myopic"))
    write_traces(table, {3: tmp_path / "three"}, episodes=2)
    added = read_rows(table, TracesRow)[4:]
    assert [(row.seed, row.condition) for row in added] == [(3, "non-myopic")]


def test_the_straight_line_is_played_once_for_all_seeds(tmp_path, monkeypatch) -> None:
    experiment, played = EXPERIMENTS["zones-8"], list[str]()
    agent = SimpleNamespace(arena=experiment.arena, design=experiment.task, policy="scripted")
    monkeypatch.setattr(zones, "load_agent", lambda run: agent)
    monkeypatch.setattr(zones, "CONDITIONS", ("blocked",))

    def play(task: ReachTask, name: str) -> Callable[[Observation], Float64]:
        played.append(name)
        return reference_policy(task, name)

    monkeypatch.setattr(traces, "reference_policy", play)
    write_traces(tmp_path / "t.csv", {4: tmp_path, 5: tmp_path}, episodes=2)
    assert played == ["scripted"] * 3  # of two agents, and one straight line
    first, second = read_rows(tmp_path / "t.csv", TracesRow)
    assert first.straight_line_rate == second.straight_line_rate == first.success_rate


def test_the_table_has_medians_and_the_seeds_that_reach_the_aim(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(results_tables, "RESULTS", tmp_path)
    rows = [
        TracesRow(condition, 10, share, 0.25, 0.0, seed)
        for seed, share in ((10, 1.0), (11, 0.5), (12, 0.99))
        for condition in ("reach", "formula-1", "formula-2")
    ]
    write_rows(tmp_path / "zones-8-traces.csv", rows)
    lines = {line.split(" |")[0]: line for line in results_tables.zones().splitlines()}
    assert "`zones-8`: median of 3 seeds" in lines["| "]
    assert lines["| any zone"].startswith("| any zone | ≥ 0.99 | 0.99 | 2 of 3 | 0.50 | 0.25 | – |")
    assert "| – | 0.99 | – | 0.50 | 0.25 |" in lines["| formula 1"]
    assert lines["| formulas, blocked"] == "| formulas, blocked | ≥ 0.96" + " | –" * 8 + " |"
