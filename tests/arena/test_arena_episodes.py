"""What every condition promises, over many seeds."""

import hashlib
import json
from itertools import combinations
from math import hypot
from typing import ClassVar

import pytest

from pa_ros.arena import (
    DESIGNS,
    ArenaConfig,
    ArenaError,
    Design,
    Episode,
    Kind,
    condition_named,
    conditions_for,
    design_named,
    generate,
    training_programs,
)
from pa_ros.core.errors import ConfigError
from pa_ros.language import Vocabulary, parse, satisfying

CONFIG = ArenaConfig()
SEEDS = range(60)
ALL = [(d.name, c) for d in map(design_named, DESIGNS) for c in conditions_for(d)]


def draw(design: Design, condition: str, seed: int, index: int = 0) -> Episode:
    return generate(CONFIG, design, condition_named(condition, design), seed, index)


def target_of(episode: Episode, design: Design) -> Kind:
    """The one block that the program names."""
    kinds = [block.kind for block in episode.blocks]
    named = satisfying(episode.program, [kind.words for kind in kinds], None)
    assert sum(named) == 1, (episode.program, kinds)
    return kinds[named.index(True)]


@pytest.mark.parametrize(("design_name", "condition"), ALL)
def test_blocks_are_unique_apart_and_exactly_one_is_named(design_name: str, condition: str) -> None:
    design = design_named(design_name)
    targets = set()
    for seed in SEEDS:
        episode = draw(design, condition, seed)
        kinds = [block.kind for block in episode.blocks]
        assert len(set(kinds)) == len(kinds)
        targets.add(target_of(episode, design))
        assert episode.program == parse(str(episode.program), design.vocabulary)
        low, high = CONFIG.block_radii_m
        assert all(low <= hypot(b.x, b.y) <= high for b in episode.blocks)
        for a, b in combinations(episode.blocks, 2):
            assert hypot(a.x - b.x, a.y - b.y) >= CONFIG.block_separation_m
    assert targets == set(condition_named(condition, design).targets)


@pytest.mark.parametrize("name", DESIGNS)
def test_train_never_asks_for_what_is_held_out(name: str) -> None:
    design = design_named(name)
    for seed in SEEDS:
        target = target_of(draw(design, "train", seed), design)
        assert target in design.train and target not in design.held_out


@pytest.mark.parametrize("name", DESIGNS)
def test_training_programs_name_color_and_shape(name: str) -> None:
    design = design_named(name)
    drawn = {draw(design, "train", seed).program for seed in range(200)}
    assert drawn == set(training_programs(design))
    texts = [f"NEAR(HAND, {kind.conjunction})" for kind in design.train]
    assert [str(program) for program in training_programs(design)] == texts


def test_eval_is_refused_where_nothing_is_held_out() -> None:
    with pytest.raises(ConfigError, match="'eval'"):
        condition_named("eval", design_named("2-C"))


@pytest.mark.parametrize(("condition", "axis"), [("only-color", "color"), ("only-shape", "shape")])
def test_one_property_alone_identifies_the_target(condition: str, axis: str) -> None:
    design = design_named("3-D")
    for seed in SEEDS:
        episode = draw(design, condition, seed)
        word = target_of(episode, design)[axis]
        assert str(episode.program) == f"NEAR(HAND, {word})"
        assert [b.kind[axis] for b in episode.blocks].count(word) == 1
        assert len(episode.blocks) == 4


@pytest.mark.parametrize(("condition", "axis"), [("not-color", "color"), ("not-shape", "shape")])
def test_what_is_excluded_is_on_the_table(condition: str, axis: str) -> None:
    design = design_named("3-D")
    for seed in SEEDS:
        episode = draw(design, condition, seed)
        target = target_of(episode, design)
        excluded = [
            block.kind
            for block in episode.blocks
            if f"NOT({block.kind[axis]})" in str(episode.program)
        ]
        assert excluded  # with the target's other property: NOT decides
        other = "shape" if axis == "color" else "color"
        assert any(kind[other] == target[other] for kind in excluded)


@pytest.mark.parametrize("count", range(2, 9))
def test_numbers_of_blocks(count: int) -> None:
    design = design_named("3-D")
    for seed in SEEDS:
        episode = draw(design, f"blocks-{count}", seed)
        assert len(episode.blocks) == count
        assert target_of(episode, design) in design.held_out


def is_new(kind: Kind) -> bool:
    return kind["shape"] == "CAPSULE" or kind["color"] == "MAGENTA"


def test_new_blocks_are_distractors_only() -> None:
    design = design_named("3-D")
    for seed in SEEDS:
        episode = draw(design, "ignore-new", seed)
        target = target_of(episode, design)
        assert not is_new(target)
        assert any(is_new(block.kind) for block in episode.blocks)


@pytest.mark.parametrize(
    ("condition", "new_shape", "new_color"),
    [
        ("reach-new-shape", True, False),
        ("reach-new-color", False, True),
        ("reach-new-both", True, True),
    ],
)
def test_the_novel_is_reached_for(condition: str, new_shape: bool, new_color: bool) -> None:
    design = design_named("3-D")
    for seed in SEEDS:
        target = target_of(draw(design, condition, seed), design)
        assert (target["shape"] == "CAPSULE") == new_shape
        assert (target["color"] == "MAGENTA") == new_color


def test_novel_program_is_that_of_the_appendix() -> None:
    assert str(draw(design_named("3-D"), "reach-new-both", 0).program) == (
        "NEAR(HAND, AND(OR(NOT(OR(RED, GREEN, BLUE)), A, B), "
        "OR(NOT(OR(CUBE, SPHERE, CYLINDER)), C)))"
    )


def test_novel_conditions_need_spare_words() -> None:
    assert not [name for name in conditions_for(design_named("2-L")) if name.startswith("reach")]


def test_same_seed_same_episode_and_other_seeds_differ() -> None:
    design = design_named("3-D")
    first = [draw(design, "eval", 7, index) for index in range(20)]
    again = [draw(design, "eval", 7, index) for index in reversed(range(20))][::-1]
    assert first == again
    assert len({episode.blocks for episode in first}) == 20
    assert draw(design, "eval", 8, 0).blocks != first[0].blocks


def test_targets_are_uniform() -> None:
    design = design_named("2-L")
    targets = [target_of(draw(design, "train", 0, index), design) for index in range(600)]
    for kind in design.train:
        assert 160 < targets.count(kind) < 240  # 200 ± 3.5 standard deviations


def test_custom_vocabulary_and_number_of_blocks() -> None:
    shapes, colors = ("CAPSULE", "CYLINDER", "CUBE"), ("YELLOW", "MAGENTA")
    design = Design(
        "mine",
        {"color": colors, "shape": shapes},
        Vocabulary.of(shape=(*shapes, "X"), color=colors),
        train=(Kind(color="YELLOW", shape="CAPSULE"),),
        held_out=(Kind(color="MAGENTA", shape="CUBE"),),
        n_blocks=6,
        novel={"shape": "SPHERE", "color": "RED"},
    )
    for condition in conditions_for(design):
        episode = draw(design, condition, 3)
        target_of(episode, design)
    assert len(draw(design, "train", 3).blocks) == 6
    assert condition_named("train", design, n_blocks=2).n_blocks == 2


class Crowded(ArenaConfig):
    block_separation_m: ClassVar[float] = 0.9


def test_too_many_blocks_for_the_ring_are_refused() -> None:
    design = design_named("3-C")
    crowded = Crowded(**CONFIG.fields())
    with pytest.raises(ArenaError, match="4 blocks"):
        generate(crowded, design, condition_named("train", design), 0, 0)
    with pytest.raises(ConfigError, match="got 10"):
        condition_named("train", design, n_blocks=10)


def scene(episode: Episode) -> list[object]:
    """Everything about an episode, to the micrometre and microradian."""
    blocks = [
        (*sorted(block.kind.words), *(round(x, 6) for x in (block.x, block.y, block.yaw)))
        for block in episode.blocks
    ]
    start = [round(angle, 6) for angle in episode.arm_start]
    return [str(episode.program), start, blocks]


@pytest.mark.parametrize(
    ("design", "condition", "digest"),
    [
        ("2-L", "train", "b04e40a99b7f3c8e"),
        ("3-D", "eval", "53943915d479a8a5"),
        ("3-D", "not-color", "7540b2ca4c08d139"),
    ],
)
def test_episodes_of_a_seed_are_what_they_have_always_been(design, condition, digest):
    """Another distribution, or another order of draws, would change every result there is."""
    drawn = [
        scene(draw(design_named(design), condition, seed, index))
        for seed in range(2)
        for index in range(3)
    ]
    assert hashlib.sha256(json.dumps(drawn).encode()).hexdigest()[:16] == digest
