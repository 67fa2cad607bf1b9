"""Judging detectors: right and wrong ones, and the best and the worst scenes."""

from dataclasses import replace

import numpy as np
import pytest

from laboratory.studies import results
from laboratory.studies.detectors import (
    EVERY,
    KNOWN,
    UNSEEN,
    Accuracy,
    DetectorView,
    accuracies,
    detector_conditions,
    extremes,
    named,
)
from laboratory.studies.tables import read_rows
from pa_ros.acting.executing import Actor
from pa_ros.agents import TrainedAgent
from pa_ros.arena import design_named, world_of
from pa_ros.arena.drawn_programs import novel
from pa_ros.core.errors import ConfigError
from pa_ros.language import MIN_MAX, PRODUCT, parse
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import initial_actor


def swapped(agent: TrainedAgent, one: str, other: str) -> TrainedAgent:
    """The agent with the detectors of two words of a group exchanged."""
    rows = [agent.design.vocabulary.row[word] for word in (one, other)]
    tensors = dict(agent.snapshot.tensors)
    for name in ("detectors.weight", "detectors.bias"):
        tensors[name] = tensors[name].copy()
        tensors[name][rows] = tensors[name][rows[::-1]]
    return replace(agent, snapshot=replace(agent.snapshot, tensors=tensors))


def test_right_detectors_are_judged_right(novice: TrainedAgent, tmp_path):
    rows = results.detectors({4: novice}, tmp_path, 4)
    assert len(read_rows(tmp_path / "detectors.csv", Accuracy)) == len(rows)
    assert (tmp_path / "detectors.png").stat().st_size > 10_000
    assert {row.seed for row in rows} == {4}
    assert {row.condition for row in rows} == {KNOWN, UNSEEN}
    for row in rows:
        assert row.separated == 1.0
        if row.condition == KNOWN:
            assert (row.seen, row.right) == (True, 1.0)
            assert row.on > 0.999 and row.best_distractor < 0.001
    unseen = {row.word: row for row in rows if not row.seen}
    assert set(unseen) == {"new shape", "new color"}
    # degrees of new blocks are all equal, 1/4 and 1/5: so much each known word is true of them
    assert unseen["new shape"].on == pytest.approx(0.75, abs=1e-4)
    assert unseen["new color"].on == pytest.approx(0.8, abs=1e-4)
    assert unseen["new color"].best_distractor < 0.001


@pytest.mark.parametrize("logic", [MIN_MAX, PRODUCT], ids=lambda logic: logic.name)
def test_a_new_property_is_judged_by_the_logic_that_the_agent_acts_by(novice, logic):
    agent = replace(novice, logic=logic)
    design, group = agent.design, "color"
    look = next(DetectorView(agent).looks(UNSEEN, 1))
    found = {row.word: row for row in accuracies(0, design, UNSEEN, [look])}
    expression = novel(design.values[group], design.spare(group))
    program = parse(f"NEAR(HAND, {expression})", design.vocabulary)
    p = Actor.of(agent.snapshot, logic).relevance(look.observation, program)[1:]
    new = [design.novel[group] in block.kind.words for block in look.episode.blocks]
    assert found[f"new {group}"].on == pytest.approx(np.mean(np.array(p)[new]), abs=1e-6)


def test_exchanged_detectors_are_judged_wrong(novice: TrainedAgent):
    wrong = swapped(novice, "RED", "BLUE")
    looks = list(DetectorView(wrong).looks(KNOWN, 6))
    rows = {row.word: row for row in accuracies(0, wrong.design, KNOWN, looks)}
    assert rows["RED"].on < 0.001 and rows["RED"].right < 0.5
    assert rows["RED"].separated < rows["GREEN"].separated == 1.0
    assert rows["CUBE"].right == 1.0
    best, worst = extremes(looks)
    assert best.margin > 0.99 and worst.margin < -0.5
    assert {"red", "blue"} & set(named(worst).split())
    assert named(best).split()[0] == "green"


def test_looks_are_taken_along_the_episodes_in_which_the_agent_acts(novice: TrainedAgent):
    longer = replace(novice, arena=novice.arena.changed(episode_steps=2 * EVERY))
    view = DetectorView(longer)
    looks = list(view.looks(KNOWN, 2))
    assert [(look.episode.index, look.step) for look in looks] == [
        (episode, step) for episode in (0, 1) for step in (0, EVERY, 2 * EVERY)
    ]
    shown = view.show(looks[1])
    np.testing.assert_array_equal(shown.simulation.objects(), looks[1].observation.objects)


def test_designs_without_spare_words_have_known_scenes_only(novice: TrainedAgent):
    assert detector_conditions(novice.design) == (KNOWN, UNSEEN)
    assert detector_conditions(design_named("2-L")) == (KNOWN,)
    assert detector_conditions(design_named("2-C")) == ("train",)


def test_an_agent_without_detectors_is_rejected(novice: TrainedAgent):
    config = NetworkConfig(
        world=world_of(novice.arena, novice.design), family="canonical", canonical_hidden=8
    )
    tensors = initial_actor(config, np.random.default_rng(0))
    snapshot = replace(novice.snapshot, architecture=config.architecture, tensors=tensors)
    with pytest.raises(ConfigError, match="canonical"):
        DetectorView(replace(novice, snapshot=snapshot))
