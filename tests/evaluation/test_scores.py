"""Scores: intervals, normalization, and what the references get."""

from dataclasses import replace

import numpy as np
import pytest

from pa_ros.arena import ARMS, ReachTask, design_named, preset_named
from pa_ros.arena.appearance import Look
from pa_ros.evaluation.scoring import training
from pa_ros.evaluation.scoring.benchmark import Benchmark, Scorer
from pa_ros.evaluation.scoring.evaluate import by_program, evaluate, reference_scores, run_episodes
from pa_ros.evaluation.scoring.intervals import mean_interval, normalized_interval
from pa_ros.evaluation.scoring.rewards import normalized
from pa_ros.evaluation.scoring.tables import TableError
from pa_ros.world.relations import RELATIONS

FAST, TWO_L = preset_named("fast"), design_named("2-L")


def test_interval_contains_the_mean_and_shrinks_with_episodes():
    rng = np.random.default_rng(0)
    few, many = mean_interval(rng.normal(size=20)), mean_interval(rng.normal(size=2000))
    for interval in (few, many):
        assert interval.low < interval.mean < interval.high
    assert many.high - many.low < few.high - few.low


def test_interval_of_equal_values_is_a_point():
    interval = mean_interval(np.full(10, -1.0))
    assert (interval.low, interval.mean, interval.high) == (-1.0, -1.0, -1.0)


def test_normalized_is_zero_at_random_and_one_at_scripted():
    random, scripted = np.full(8, -0.9), np.linspace(0.7, 0.9, 8)
    assert normalized_interval(random[None], random, scripted).mean == pytest.approx(0.0)
    whole = normalized_interval(scripted[None], random, scripted)
    assert (whole.low, whole.mean, whole.high) == pytest.approx((1.0, 1.0, 1.0))
    assert normalized(0.0, -1.0, 1.0) == 0.5
    assert np.isnan(normalized(0.3, 0.5, 0.5))


def test_references_bracket_the_scale():
    scripted = evaluate(FAST, TWO_L, "scripted", "eval", 5, 3)
    random = evaluate(FAST, TWO_L, "random", "eval", 5, 3)
    assert scripted.normalized.mean == pytest.approx(1.0)
    assert random.normalized.mean == pytest.approx(0.0)
    assert scripted.success_rate == 1.0
    assert scripted.raw.mean > 0.6 > random.raw.mean
    assert scripted.random == random.scores, "the same episodes and the same chance"


def test_an_agent_is_asked_with_what_it_sees_and_rows_are_per_program():
    asked = []

    def still(observation, program):
        asked.append((observation.episode, program))
        return np.zeros(6)

    evaluation = evaluate(FAST, TWO_L, still, "train", 6, 0)
    assert len(asked) == 6 * FAST.episode_steps
    assert {episode for episode, _ in asked} == set(range(6))
    rows = by_program(evaluation)
    assert sum(row.episodes for row in rows) == 6
    assert {row.program for row in rows} == {str(program) for _, program in asked}
    assert "NEAR(HAND, AND(BLUE, SPHERE))" not in {row.program for row in rows}


def test_a_score_leaves_the_resets_reward_out(monkeypatch):
    task = ReachTask(FAST.changed(episode_steps=3), TWO_L, 0)
    step = task.step

    def rewarded(velocity):
        observation, verdict = step(velocity)
        return observation, replace(verdict, reward=1.0)

    monkeypatch.setattr(task, "step", rewarded)
    scores = list(run_episodes(task, lambda _: np.zeros(6), "train", 2))
    assert [score.reward_per_step for score in scores] == [1.0, 1.0]  # with a reset's -1: 0.5


def test_a_training_that_is_never_scored_plays_no_reference(monkeypatch):
    played = []

    def play(task, name, condition, episodes):
        played.append((name, condition))
        return reference_scores(task, name, condition, episodes)

    class Still:
        def act(self, observation, program):
            return np.zeros(FAST.joints, np.float32)

    monkeypatch.setattr(training, "reference_scores", play)
    scores = training.TrainingScores(FAST, TWO_L, 2)
    assert played == []
    first, again = scores(Still()), scores(Still())
    assert first == again and len(played) == 4  # both references, of both conditions, once


def test_scores_that_were_cut_are_no_mean_of_the_rest(tmp_path):
    benchmark = Benchmark(design=TWO_L, arena=FAST.changed(episode_steps=3), episodes=3)
    scorer = Scorer(benchmark, tmp_path)
    scorer.reference("random", "eval")
    path = scorer.path("random", "eval")
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-1]))
    with pytest.raises(TableError, match="expected episodes 0 to 2, got 2"):
        scorer.reference("random", "eval")


def test_scores_of_another_arm_look_or_relation_of_one_name_are_not_its(monkeypatch):
    benchmark = Benchmark(design=TWO_L, arena=FAST, episodes=3)
    jaco, near = ARMS["jaco"], RELATIONS["NEAR"]
    arms, relations = {"jaco": jaco}, {"NEAR": near}
    for room in ("arena.model", "evaluation.scoring.benchmark"):
        monkeypatch.setattr(f"pa_ros.{room}.ARMS", arms)
    for room in ("world.scoring", "evaluation.scoring.benchmark"):
        monkeypatch.setattr(f"pa_ros.{room}.RELATIONS", relations)
    first, *others = jaco.joints
    changes = [
        (arms, "jaco", replace(jaco, joints=(replace(first, max_torque=9.0), *others))),
        (arms, "jaco", replace(jaco, joints=(replace(first, limits=(-4.0, 4.0)), *others))),
        (
            arms,
            "jaco",
            replace(jaco, mjcf=lambda *given: jaco.mjcf(*given).replace("0.99", "1.99")),
        ),
        (relations, "NEAR", replace(near, threshold=0.1)),
        (relations, "NEAR", replace(near, measure=lambda *given: 2 * near.measure(*given))),
        (relations, "NEAR", replace(near, goal=lambda hand, place, threshold: place)),
    ]
    digests = [benchmark.digest]
    assert digests == [Benchmark(design=TWO_L, arena=FAST, episodes=3).digest]
    for known, name, changed in changes:
        with monkeypatch.context() as only_here:
            only_here.setitem(known, name, changed)
            digests.append(benchmark.digest)
    assert benchmark.digest == digests[0]
    monkeypatch.setattr("pa_ros.evaluation.scoring.benchmark.look_of", lambda _: Look(density=2.0))
    digests.append(benchmark.digest)
    assert len(set(digests)) == len(digests) == 8
