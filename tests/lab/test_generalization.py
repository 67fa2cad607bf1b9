"""Scores under every condition: paired, kept and summarized; and references that are blind."""

import json
from typing import Any

import numpy as np
import pytest

from laboratory.studies import results, scorer
from laboratory.studies.generalization import ConditionRow, Summary, generalize, setting, summarize
from laboratory.studies.scorer import Benchmark, Scorer
from laboratory.studies.tables import read_rows
from pa_ros.agents import TrainedAgent, without_training
from pa_ros.arena import ReachTask, conditions_for, design_named, preset_named
from pa_ros.core.errors import ConfigError
from pa_ros.evaluation.blind import BLIND, blind_policy
from pa_ros.evaluation.conditions import CONDITIONS, conditions_of
from pa_ros.evaluation.evaluate import EPISODES_SEED, layouts_seed, run_episodes
from pa_ros.language import parse


def test_the_papers_conditions_come_in_its_order():
    names = conditions_of(design_named("3-D"))
    paper = (
        "train random eval only-color only-shape not-color not-shape blocks-2 blocks-3 blocks-5 "
        "blocks-6 blocks-8 ignore-new reach-new-shape reach-new-color reach-new-both"
    ).split()
    assert list(names[: len(paper)]) == paper
    assert names == CONDITIONS
    assert not {"eval", "reach-new-both"} & set(conditions_of(design_named("2-C")))


def test_all_conditions_include_those_of_custom_groups_and_relations() -> None:
    design = design_named("sizes").with_relations("NEAR", "ABOVE")
    own = "only-size not-size train-near train-above eval-near eval-above eval-unseen".split()
    names = conditions_of(design)
    assert list(names[-len(own) :]) == own
    by_success = set(conditions_for(design)) - set(names)
    assert all(name.startswith(("blocks-", "chain-", "compare")) for name in by_success)
    assert {"blocks-4", "compare", "compare-size", "chain-2"} <= by_success
    assert set(names) - set(conditions_for(design)) == {"random"}
    assert "blocks-4" in conditions_of(design_named("push-3D"))
    for name in ("2-L", "3-D-exact"):
        assert set(conditions_of(design_named(name))) <= set(CONDITIONS)


def quiet(_: str) -> None:
    pass


def test_every_row_has_the_references_of_its_episode(novice: TrainedAgent, tmp_path):
    agents = {0: novice, 7: without_training(novice, 7)}
    rows = generalize(agents, tmp_path, 3, ("random", "eval"), quiet)
    assert [(row.seed, row.condition, row.episode) for row in rows] == [
        (seed, condition, episode)
        for condition in ("random", "eval") for seed in (0, 7) for episode in range(3)
    ]  # fmt: skip
    first, second = rows[6:9], rows[9:]
    for one, other in zip(first, second, strict=True):
        for name in ("program", "scripted", "random", *BLIND):
            assert getattr(one, name) == getattr(other, name)
    assert [row.distance for row in first] != [row.distance for row in second]
    trained = {f"NEAR(HAND, {kind.conjunction})" for kind in novice.design.train}
    assert {row.program for row in rows[:6]} <= trained, "`random` is asked what `train` asks"
    assert not {row.program for row in first} & trained


def test_scores_are_computed_once(novice: TrainedAgent, tmp_path, monkeypatch):
    before = generalize({0: novice}, tmp_path, 2, ("eval",), quiet)

    def fail(*_: object) -> None:
        raise AssertionError("scored again")

    monkeypatch.setattr(scorer, "run_episodes", fail)
    assert generalize({0: novice}, tmp_path, 2, ("eval",), quiet) == before
    for changed in ({0: without_training(novice, 0)}, {0: novice}):
        with pytest.raises(AssertionError):
            generalize(changed, tmp_path, 3, ("eval",), quiet)


def test_agents_of_different_settings_are_rejected(novice: TrainedAgent, tmp_path):
    other = TrainedAgent(novice.snapshot, novice.design, preset_named("paper"))
    with pytest.raises(ConfigError, match=r"\('3-D', 'jaco', 'paper'\)"):
        generalize({0: novice, 1: other}, tmp_path)
    with pytest.raises(ConfigError, match="sideways"):
        generalize({0: novice}, tmp_path, 2, ("sideways",), quiet)
    described: dict[str, Any] = setting({4: novice}, 5)
    assert described["preset"] == "fast" and described["words"]["color"][-2:] == ("A", "B")


def row(seed: int, episode: int, reward: float, **fields: float) -> ConditionRow:
    values = {"scripted": 0.8, "random": -1.0, "nearest": -0.4, "any": -0.1, "most": -0.2}
    return ConditionRow(seed, "eval", episode, "P", reward, reward > 0, 0.1, **(values | fields))


def test_summary_of_two_seeds():
    rows = [row(0, 0, 0.8), row(0, 1, 0.8), row(1, 0, -0.1), row(1, 1, -1.0)]
    (summary,) = summarize(rows)
    assert (summary.seeds, summary.episodes, summary.seeds_above_0_9) == (2, 2, 1)
    assert summary.normalized == pytest.approx((1 + 1 + 0.5 + 0) / 4)
    assert summary.worst_seed == pytest.approx(0.25)
    assert (summary.blind, summary.blind_normalized) == ("any", pytest.approx(0.5))
    assert summary.gain == pytest.approx(summary.normalized - 0.5)
    assert summary.low <= summary.normalized <= summary.high
    assert summary.success_rate == 0.5


def test_who_pushes_without_reading_the_program_rarely_succeeds():
    task = ReachTask(preset_named("push"), design_named("push-2"), seed=5)
    for name in BLIND:
        scores = list(run_episodes(task, blind_policy(task, name), "eval", 12))
        assert np.mean([score.success for score in scores]) <= 0.5


@pytest.mark.parametrize("preset", ["fast", "paper"])
def test_blind_references_reach_blocks_whatever_the_program(preset: str):
    task = ReachTask(preset_named(preset), design_named("3-D"), seed=5)
    near = {}
    for name in BLIND:
        policy = blind_policy(task, name)
        counts, actions = [], []
        for episode in range(8):
            observation, verdict = task.reset(episode, "eval")
            not_red = parse("NEAR(HAND, NOT(RED))", task.design.vocabulary)
            task.set_program(not_red if episode % 2 else task.program)
            actions.append(policy(observation))
            while not verdict.truncated:
                observation, verdict = task.step(policy(observation))
            distances = np.linalg.norm(observation.objects[1:, :3], axis=1)
            counts.append((distances <= task.scoring.threshold("NEAR")).sum())
        assert min(counts) >= 1
        near[name] = np.mean(counts)
        assert np.ptp(actions, axis=0).max() > 0.1
    assert near["most"] > near["any"]


def test_random_weights_move_the_arm_and_depend_on_the_seed(novice: TrainedAgent):
    task = ReachTask(novice.arena, novice.design, seed=0)
    still = []
    for seed in (0, 1):
        policy = without_training(novice, seed).policy
        observation, _ = task.reset(0)
        still.append(policy(observation, task.program))
        assert np.abs(still[-1]).max() > 0.05
    assert not np.array_equal(still[0], still[1])
    assert without_training(novice, 1).digest != novice.digest != without_training(novice, 2).digest


def test_kept_scores_are_those_of_a_fresh_run(novice: TrainedAgent, tmp_path):
    setup = Benchmark(design=novice.design, arena=novice.arena, episodes=2, seed=9)
    kept = Scorer(setup, tmp_path).agent(novice, "eval")
    task, policy = ReachTask(novice.arena, novice.design, 9), novice.policy
    fresh = list(run_episodes(task, lambda o: policy(o, task.program), "eval", 2))
    assert [score.program for score in kept] == [score.program for score in fresh]
    np.testing.assert_allclose(
        [score.distance for score in kept], [score.distance for score in fresh], rtol=1e-5
    )


def test_the_study_writes_tables_and_a_picture_that_can_be_redrawn(novice, tmp_path):
    agents = {0: novice, 1: without_training(novice, 1)}
    lines: list[str] = []
    out = tmp_path / "results"
    chosen = ("eval", "depth-3")
    summaries = results.generalization(
        agents, out, tmp_path / "cache", 2, ".x", lines.append, chosen
    )
    assert (
        len(read_rows(out / "generalization.x.csv", ConditionRow)) == 2 * 2 * 2
        and len(lines) == 2 * 2
    )
    assert [s.condition for s in summaries] == list(chosen)
    assert len(read_rows(out / "generalization-summary.x.csv", Summary)) == 2
    facts = json.loads((out / "generalization.x.json").read_text())
    assert facts["agents"]["1"]["weights"] == agents[1].digest
    picture = out / "generalization.x.png"
    before = picture.read_bytes()
    picture.unlink()
    assert results.redraw_generalization(out / "generalization.x.csv") == picture
    assert picture.read_bytes() == before


def test_conditions_share_layouts(novice: TrainedAgent) -> None:
    task = ReachTask(novice.arena, novice.design, EPISODES_SEED)
    places = []
    for condition in ("train", "eval"):
        task.reset(0, condition)
        places.append([(block.x, block.y) for block in task.episode.blocks])
    assert places[0] == places[1]
    assert layouts_seed(1, "eval") != layouts_seed(1, "train") == layouts_seed(1, "train")
