"""Logically equal programs: the laws are laws, the exact ones over soft sets too."""

from dataclasses import replace

import numpy as np
import pytest

from laboratory.studies import results
from laboratory.studies.equalities import CONDITIONS, LAWS, Difference, Law, difference_table
from laboratory.studies.tables import read_rows
from pa_ros.agents import TrainedAgent, load_agent
from pa_ros.arena import condition_named, design_named, generate, preset_named
from pa_ros.language import LOGICS, Logic, Program, Word, parse, relevance, satisfying

THREE_D = design_named("3-D")


def pairs(law: Law, condition: str, count: int = 15):
    """Both programs of a law in episodes of a condition, and the blocks there."""
    drawn_from = condition_named(condition, THREE_D)
    for index in range(count):
        episode = generate(preset_named("fast"), THREE_D, drawn_from, 1, index)
        program = episode.program
        kinds = [block.kind for block in episode.blocks]
        named = satisfying(program, [kind.words for kind in kinds], None)
        target = kinds[named.index(True)]
        sides = law.pair(program.target, Word(target["color"]), Word(target["shape"]))
        yield program, [Program(side) for side in sides], kinds


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_both_sides_name_the_target_and_differ_as_text(law: Law, condition: str):
    for program, (left, right), kinds in pairs(law, condition):
        assert str(left) != str(right)
        assert parse(str(right), THREE_D.vocabulary) == right
        words = [kind.words for kind in kinds]
        named = satisfying(program, words, None)
        assert satisfying(left, words, None) == satisfying(right, words, None) == named
        everything = [kind.words for kind in THREE_D.pool]
        assert satisfying(left, everything, None) == satisfying(right, everything, None)


@pytest.mark.parametrize("logic", LOGICS.values(), ids=LOGICS)
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_exact_laws_hold_over_soft_sets_and_the_others_over_crisp_ones(law: Law, logic: Logic):
    rng = np.random.default_rng(0)
    row = THREE_D.vocabulary.row
    largest = 0.0
    for _, sides, _ in pairs(law, "depth-3"):
        soft = rng.uniform(size=(len(row), 6))
        p, q = (np.array(relevance(side, soft.tolist(), row, 0, logic)) for side in sides)
        largest = max(largest, float(np.abs(p - q).max()))
        crisp = np.round(soft)
        p, q = (np.array(relevance(side, crisp.tolist(), row, 0, logic)) for side in sides)
        np.testing.assert_array_equal(p, q)
    exact = logic.name in law.exact
    assert (largest < 1e-12) == exact, largest
    assert exact or largest > 0.05


def test_an_agent_with_crisp_detectors_acts_alike_under_all_laws(novice: TrainedAgent, tmp_path):
    rows = results.equalities({5: novice}, tmp_path, 2)
    assert len(read_rows(tmp_path / "equalities.csv", Difference)) == len(rows)
    assert [(row.condition, row.law) for row in rows] == [
        (condition, law.name) for condition in CONDITIONS for law in LAWS
    ]
    for row in rows:
        assert (row.seed, row.episodes) == (5, 2)
        assert row.p <= (1e-6 if row.exact else 1e-3)
        assert row.action <= (1e-5 if row.exact else 1e-2)
        assert row.score <= 0.2 and abs(row.mean_score) <= row.score


@pytest.mark.parametrize("logic", LOGICS.values(), ids=LOGICS)
def test_only_the_inexact_laws_notice_blurred_detectors(novice: TrainedAgent, logic: Logic):
    novice.snapshot.tensors["detectors.weight"][:] /= 6
    rows = difference_table({0: replace(novice, logic=logic)}, 1)
    for row in rows:
        assert (row.p > 1e-2) != row.exact, row


def test_agents_that_see_are_compared_through_their_cameras() -> None:
    pytest.importorskip("cv2", reason="no OpenCV: install programmable-agents[camera]")
    rows = difference_table({0: load_agent("shipped:camera")}, 1)
    assert max(row.p for row in rows if row.exact) < 1e-6
