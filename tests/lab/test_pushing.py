"""How episodes end in which blocks are moved: by seed and condition, spheres apart."""

import math
import sys
from dataclasses import replace
from pathlib import Path

from laboratory.studies import scorer
from laboratory.studies.experiments import EXPERIMENTS, run_seed
from laboratory.studies.pushing import ends_of
from laboratory.studies.tables import write_rows
from pa_ros.agents import load_agent
from pa_ros.evaluation.pushing import EndsRow, ends
from pa_ros.evaluation.scores import EpisodeScore

sys.path.append(str(Path(__file__).parents[2] / "docs"))
import results_tables  # noqa: E402  (a script beside the docs)


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
