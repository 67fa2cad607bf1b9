"""RESULTS.md and model cards state what was measured, and how episodes of moved blocks end."""

import json
import math
import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

import pa_ros
from laboratory.studies import scorer
from laboratory.studies.cards import SCORES, model_card
from laboratory.studies.experiments import EXPERIMENTS, run_seed
from laboratory.studies.pushing import ends_of
from laboratory.studies.tables import write_rows
from pa_ros.agents import load_agent
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.evaluation.pushing import EndsRow, ends
from pa_ros.evaluation.scores import EpisodeScore
from pa_ros.learning.checkpoint_files import SHIPPED

sys.path.append(str(Path(__file__).parents[2] / "docs"))
import results_tables  # noqa: E402  (a script beside the docs)


@pytest.mark.parametrize("page", results_tables.PAGES, ids=lambda page: page.name)
def test_make_results_leaves_the_page_unchanged(page):
    assert results_tables.filled(page.read_text()) == page.read_text()


def test_shares_of_seeds_have_exact_intervals() -> None:
    beta = pytest.importorskip("scipy.stats").beta
    for successes, count in ((10, 10), (3, 10), (0, 3), (1, 2)):
        low, high = results_tables.share_interval(successes, count)
        assert low == pytest.approx(
            beta.ppf(0.025, successes, count - successes + 1) if successes else 0, abs=1e-9
        )
        assert high == pytest.approx(
            beta.ppf(0.975, successes + 1, count - successes) if successes < count else 1, abs=1e-9
        )
    assert results_tables.share_interval(10, 10)[0] == pytest.approx(0.69, abs=0.005)


@pytest.mark.parametrize("name", sorted(folder.name for folder in SHIPPED.iterdir()))
def test_the_card_of_a_shipped_agent_is_made_from_its_recorded_scores(name):
    card = (SHIPPED / name / "README.md").read_text()
    assert card == results_tables.card(SHIPPED / name)
    (result,) = yaml.safe_load(card.split("---\n")[1])["model-index"]
    scores = {(m["type"], m["name"]) for m in result["results"][0]["metrics"]}
    named = [(kind, name) for kind in SCORES for name in ("held-out programs", "trained programs")]
    assert scores == {*named}
    rows = card.partition("| --- |")[2].splitlines()[1:]
    assert [row.count("|") for row in rows[: len(named) + 4]] == [4] * 8  # two, and the lowest six
    assert result["name"].endswith("-camera") == (name == "camera")
    for function in re.findall(r"`pa_ros\.(\w+)\(", card):
        assert function in pa_ros.__all__


def test_a_card_has_scores_that_a_hub_reads(tmp_path):
    agent = load_agent("shipped:2-L")
    report: dict[str, float | int | str] = {
        "eval.eval.normalized": 0.25,
        "eval.eval.success_rate": 0.5,
        "versions": "software 1",
        "eval.episodes": 7,
        "eval.weights": agent.digest,
    }
    scores, card = tmp_path / "scores.json", tmp_path / "card.md"
    scores.write_text(json.dumps(report))
    given = ["--card", str(card), "--scores", str(scores)]
    assert main(["export", "shipped:2-L", *given]) == 0
    header = yaml.safe_load(card.read_text().split("---\n")[1])
    (result,) = header["model-index"][0]["results"]
    assert result["metrics"] == [
        {"type": "normalized", "name": "held-out programs", "value": 0.25},
        {"type": "success_rate", "name": "held-out programs", "value": 0.5},
    ]
    assert "| held-out programs | 0.25 | 50% |" in card.read_text()
    del report["eval.eval.normalized"]  # agents that move blocks have shares of success alone
    assert "| held-out programs | – | 50% |" in model_card("shipped:2-L", report)
    scores.write_text(json.dumps(report | {"eval.weights": "another"}))
    assert main(["export", "shipped:3-D", *given]) == 2
    with pytest.raises(ConfigError, match="expected measured scores, got none"):
        model_card("shipped:2-L", {"eval.weights": agent.digest})


def test_each_seed_and_condition_has_its_shares_and_is_scored_once(tmp_path, monkeypatch) -> None:
    options = {"learner.replay.warmup_frames": 100, "learner.replay.batch_size": 8}
    short = replace(EXPERIMENTS["push-3D"], frames=200, evaluate_every_frames=200, options=options)
    run_seed(short, 0, tmp_path / "run", scores=lambda _: {"train_greedy.success_rate": 0.0})
    agents = {0: load_agent(tmp_path / "run")}
    asked = tmp_path / "scores", 3, ("eval", "reach")
    rows = ends_of(agents, *asked)
    for condition in asked[2]:
        assert sum(row.episodes for row in rows if row.condition == condition) == 3
    for row in rows:
        assert 0.0 <= row.success <= row.ever <= 1.0
        assert math.isnan(row.close) == (row.condition == "reach") != math.isnan(row.normalized)
    monkeypatch.setattr(scorer, "run_episodes", None)  # stored scores are read
    assert str(ends_of(agents, *asked)) == str(rows)


def test_programs_that_name_a_sphere_are_apart_but_not_those_that_exclude_it() -> None:
    vocabulary = EXPERIMENTS["push-3D"].task.vocabulary
    place = "AND(RED, PLACE)"
    programs = {f"NEAR(AND(RED, SPHERE), {place})": 0.05, f"NEAR(AND(RED, CUBE), {place})": 0.09,
                f"NEAR(AND(RED, NOT(SPHERE)), {place})": 0.05}  # fmt: skip
    scores = [EpisodeScore(i, program, 0.0, True, distance, True)
              for i, (program, distance) in enumerate(programs.items())]  # fmt: skip
    others, spheres = ends(scores, vocabulary)
    assert (spheres.close, spheres.episodes) == (1.0, 1)
    assert (others.close, others.episodes) == (0.5, 2)
    on = "ON({}, AND(RED, PLACE))".format
    tower = f"ALL({on('SPHERE')}, {on('RED')})"  # of several programs, and of no distance in m
    scores = [EpisodeScore(0, tower, 0.0, True, 0.05, True)]
    (row,) = ends(scores, EXPERIMENTS["stack-3D"].task.vocabulary)
    assert row.spheres and math.isnan(row.close) and row.success == 1.0


def test_claims_have_medians_intervals_and_the_seeds_that_reach_the_aim(tmp_path, monkeypatch):
    rows = [
        EndsRow(seed, condition, spheres, 50, share, 1.0, share, math.nan)
        for seed, share in ((0, 0.99), (1, 0.98), (2, 0.5))
        for condition in ("train", "moved-or", "depth-3")
        for spheres in (False, True)
    ]
    monkeypatch.setattr(results_tables, "RESULTS", tmp_path)
    write_rows(tmp_path / "push-3D-conditions.csv", rows)
    lines = {line.split(" |")[0]: line for line in results_tables.claims().splitlines()}
    trained = lines["| trained pairs, 3 × 3 kinds"]
    assert "| ≥ 0.97 | 0.98 [0.50, 0.99] | 2 of 3 | 0.50 | 1.00 |" in trained
    assert "slow arm (aim 0.85)" in results_tables.claims().splitlines()[-1]


def test_what_is_not_measured_is_named_in_place_of_a_table(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(results_tables, "RESULTS", tmp_path)
    assert results_tables.claims().startswith("Not measured yet: ")
