"""Relations in the arena: episodes, verdicts and pictures."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pa_ros.arena import (
    Kind,
    ReachTask,
    conditions_for,
    design_named,
    preset_named,
    training_programs,
)
from pa_ros.arena.references import nearest_target
from pa_ros.arena.render import outline, top_view
from pa_ros.core.errors import ConfigError
from pa_ros.world.relation import RELATIONS

FAST, TWO_L = preset_named("fast"), design_named("2-L")
OF_ANY_HAND = [name for name in RELATIONS if name not in ("HOLD", "ON")]
SIX = TWO_L.with_relations(*OF_ANY_HAND)


def test_programs_have_every_relation_and_depend_on_the_seed_alone() -> None:
    task = ReachTask(FAST, SIX, seed=0)
    asked = []
    for index in range(40):
        task.reset(index)
        asked.append(str(task.program))
    assert {text.partition("(")[0] for text in asked} == set(SIX.vocabulary.relations)
    task.reset(7)
    assert str(task.program) == asked[7]
    assert len(training_programs(SIX)) == 6 * len(training_programs(TWO_L))
    assert {str(program) for program in training_programs(SIX)} >= set(asked)


def test_conditions_of_one_relation_use_only_that_relation() -> None:
    two = TWO_L.with_relations("NEAR", "IN_FRONT_OF")
    of_one = {"train-near", "train-in-front-of", "eval-near", "eval-in-front-of"}
    assert of_one <= set(conditions_for(two))
    assert conditions_for(TWO_L) == (
        "train", "eval", "only-color", "only-shape", "not-color", "not-shape", "blocks-2",
        "blocks-3", "blocks-4", "ignore-new", "depth-3", "depth-4", "depth-5", "depth-6",
        "several-1", "several-2", "several-3", "several-all", "compare",
    )  # fmt: skip
    task = ReachTask(FAST, two, seed=0)
    for index in range(6):
        task.reset(index, "eval-in-front-of")
        assert str(task.program) == "IN_FRONT_OF(HAND, AND(BLUE, SPHERE))"


def test_held_out_combinations_are_drawn_in_their_own_condition_alone() -> None:
    held_out = ("ABOVE", TWO_L.train[0]), ("LEFT_OF", TWO_L.train[1])
    design = replace(SIX, held_out_combinations=held_out)
    texts = {f"{relation}(HAND, {kind.conjunction})" for relation, kind in held_out}
    trained = set(map(str, training_programs(design)))
    assert {str(p) for p in training_programs(SIX)} - texts == trained
    task = ReachTask(FAST, design, seed=0)

    def drawn(condition: str) -> set[str]:
        found = set()
        for index in range(60):
            task.reset(index, condition)
            found.add(str(task.program))
        return found

    assert not drawn("train") & texts
    assert drawn("eval-combinations") == texts
    assert drawn("eval-combinations-above") == {"ABOVE(HAND, AND(RED, CUBE))"}
    assert drawn("train-above") == {f"ABOVE(HAND, {k.conjunction})" for k in TWO_L.train[1:]}
    assert not any("combinations" in name for name in conditions_for(SIX))
    assert design.with_relations("NEAR", "ABOVE").held_out_combinations == held_out[:1]


def test_3d_relations_holds_out_each_relation_with_one_target() -> None:
    design = design_named("3-D-relations")
    held_out = [relation for relation, _ in design.held_out_combinations]
    assert held_out == [*SIX.vocabulary.relations]
    assert {kind for _, kind in design.held_out_combinations} == set(design.train)
    assert len(training_programs(design)) == 6 * 6 - 6
    assert {"eval-combinations-behind", "eval-near", "several-2"} <= set(conditions_for(design))


def test_3d_above_red_trains_above_with_red_blocks_alone() -> None:
    design = design_named("3-D-above-red")
    above = [p for p in training_programs(design) if p.relation == "ABOVE"]
    assert [str(p.target) for p in above] == ["AND(RED, SPHERE)", "AND(RED, CYLINDER)"]
    assert len(training_programs(design)) == 6 + 2


@pytest.mark.parametrize("wrong", [("ABOVE", TWO_L.train[0]), ("NEAR", TWO_L.held_out[0])])
def test_a_combination_must_be_one_of_the_design(wrong: tuple[str, Kind]) -> None:
    with pytest.raises(ConfigError, match="held_out_combinations"):
        replace(TWO_L, held_out_combinations=(wrong,))
    with pytest.raises(ConfigError, match="expected a training program"):
        replace(TWO_L, held_out_combinations=tuple(("NEAR", kind) for kind in TWO_L.train))


def test_an_arena_can_set_the_thresholds() -> None:
    two = TWO_L.with_relations("NEAR", "ABOVE")
    strict = ReachTask(FAST.changed(thresholds=(0.1, 0.2)), two, 0)
    assert strict.scoring.thresholds == {"NEAR": 0.1, "ABOVE": 0.2}
    with pytest.raises(ConfigError, match="thresholds: expected none, or one for each of"):
        ReachTask(FAST.changed(thresholds=(0.1,)), two, 0)


@pytest.mark.parametrize("relation", OF_ANY_HAND)
def test_pictures_draw_a_line_around_where_a_relation_holds(relation: str) -> None:
    task = ReachTask(FAST, TWO_L.with_relations(relation), seed=0)
    task.reset(0)
    line, hand = outline(task), task.simulation.positions[0]
    around = hand if relation == "NEAR" else nearest_target(task)
    assert (np.linalg.norm(line - around[:2], axis=1) <= 0.3).all()
    picture = top_view(task).astype(int)
    assert picture.shape == (480, 480, 3)

    def seen(place: np.ndarray, right: int = 0) -> np.ndarray:
        """The color at a place (m), or some pixels to its right."""
        return picture[int(240 - 300 * place[1]), int(240 + 300 * place[0]) + right]

    black = [seen(place).max() < 60 for place in line if np.abs(place).max() < 0.79]
    assert 0.1 < np.mean(black) < 0.9, "a dotted line"
    links = task.simulation.link_positions
    arm = [(seen((a + b) / 2) == (85, 85, 96)).all() for a, b in pairwise(links[1:])]
    assert sum(arm) >= 3
    for i, block in enumerate(task.episode.blocks, 1):
        colors = [seen(task.simulation.positions[i], right) for right in range(16)]
        if i in task.verifier.named:
            assert min(color.max() for color in colors[8:13]) < 60, "a black edge"
        else:
            assert np.abs(colors[:8] - 255 * np.array(block.look.rgb)).max() < 2
            assert (colors[15] == (232, 224, 216)).all(), "the table"
