"""Episodes of every condition, over many seeds, and random deep programs."""

import hashlib
import json
from dataclasses import replace
from itertools import combinations, product
from math import hypot
from typing import ClassVar

import numpy as np
import pytest

from pa_ros.arena import (
    ARMS,
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
from pa_ros.arena.drawn_programs import DeepPrograms
from pa_ros.arena.reaching import DEPTHS
from pa_ros.language import And, Expression, Not, Or, Program, Vocabulary, Word, parse, satisfying
from pa_ros.language.syntax import walk

CONFIG, THREE_D = ArenaConfig(), design_named("3-D")
SEEDS = range(40)
# Deep programs are slow to draw; `depth-3` stands for all depths here.
SLOW = {f"depth-{depth}" for depth in DEPTHS[1:]}
REACHING = [name for name in DESIGNS  # that of several relations: test_relations.py, test_zones.py
            if not design_named(name).vocabulary.moves_objects
            and design_named(name).skill_name != "zones"
            and len(design_named(name).vocabulary.relations) == 1]  # fmt: skip
CONDITIONS = {name: conditions_for(design_named(name)) for name in REACHING}
NOT_ONE = ("several", "compare", "finite")
SEVERAL = [(name, c) for name in REACHING for c in CONDITIONS[name] if c.startswith("several")]


def draw(design: Design, condition: str, seed: int, index: int = 0) -> Episode:
    return generate(CONFIG, design, condition_named(condition, design), seed, index)


def target_of(episode: Episode, design: Design) -> Kind:
    """The one block that the program names."""
    kinds = [block.kind for block in episode.blocks]
    named = satisfying(episode.program, [kind.words for kind in kinds], None)
    assert sum(named) == 1, (episode.program, kinds)
    return kinds[named.index(True)]


@pytest.mark.parametrize("design_name", REACHING)
def test_blocks_are_unique_apart_and_exactly_one_is_named(design_name: str) -> None:
    for condition in CONDITIONS[design_name]:
        if condition not in SLOW and not condition.startswith(NOT_ONE):
            check(design_named(design_name), condition)


def check(design: Design, condition: str) -> None:
    targets, possible = set[Kind](), condition_named(condition, design).targets
    for seed in range(max(40, 8 * len(possible))):
        episode = draw(design, condition, seed)
        kinds = [block.kind for block in episode.blocks]
        count = condition_named(condition, design).n_blocks
        assert len(set(kinds)) == len(kinds) <= count
        assert len(kinds) == count or not condition.startswith("blocks"), condition
        targets.add(target_of(episode, design))
        assert episode.program == parse(str(episode.program), design.vocabulary)
        low, high = ARMS[CONFIG.arm].block_radii_m
        assert all(low <= hypot(b.x, b.y) <= high for b in episode.blocks)
        for a, b in combinations(episode.blocks, 2):
            assert hypot(a.x - b.x, a.y - b.y) >= CONFIG.block_separation_m
    assert targets == set(possible), condition


@pytest.mark.parametrize("name", REACHING)
def test_training_programs_name_color_and_shape(name: str) -> None:
    design = design_named(name)
    drawn = {draw(design, "train", seed).program.relation_alone for seed in range(200)}
    assert drawn == set(training_programs(design))
    texts = [f"NEAR(HAND, {kind.conjunction})" for kind in design.train]
    assert [str(program) for program in training_programs(design)] == texts


@pytest.mark.parametrize(("condition", "axis"), [("not-color", "color"), ("not-shape", "shape")])
def test_excluded_blocks_are_on_the_table(condition: str, axis: str) -> None:
    for seed in SEEDS:
        episode = draw(THREE_D, condition, seed)
        target = target_of(episode, THREE_D)
        kinds, text = [block.kind for block in episode.blocks], str(episode.program)
        excluded = [kind for kind in kinds if f"NOT({kind[axis]})" in text]
        assert excluded  # with the target's other property: NOT decides
        other = "shape" if axis == "color" else "color"
        assert any(kind[other] == target[other] for kind in excluded)


@pytest.mark.parametrize(("design_name", "condition"), SEVERAL)
def test_short_programs_name_so_many_blocks(design_name: str, condition: str) -> None:
    design, count = design_named(design_name), condition.removeprefix("several-")
    forms = set()
    for seed in range(60):
        episode = draw(design, condition, seed)
        named = satisfying(episode.program, [b.kind.words for b in episode.blocks], None)
        assert len({block.kind for block in episode.blocks}) == len(named) <= design.n_blocks
        assert sum(named) == (design.n_blocks if count == "all" else int(count))
        assert all(named) == (count == "all")
        forms.add(type(episode.program.target))
    assert Or in forms and forms <= {Word, Not, Or}


@pytest.mark.parametrize("group", ["color", "shape"])
def test_one_property_alone_names_the_target(group: str) -> None:
    for seed in SEEDS:
        drawn = draw(THREE_D, f"only-{group}", seed)
        assert str(drawn.program.target) in THREE_D.values[group]


def test_the_only_other_block_is_the_new_one() -> None:
    for seed in SEEDS:
        drawn = draw(replace(THREE_D, n_blocks=2), "ignore-new", seed)
        new = [one for one in drawn.blocks if one.kind not in THREE_D.pool]
        assert len(drawn.blocks) == 2 and len(new) == 1


def test_novel_program_is_that_of_the_appendix() -> None:
    assert str(draw(THREE_D, "reach-new-both", 0).program) == (
        "NEAR(HAND, AND(OR(NOT(OR(RED, GREEN, BLUE)), A, B), "
        "OR(NOT(OR(CUBE, SPHERE, CYLINDER)), C)))"
    )


def test_novel_conditions_need_spare_words() -> None:
    assert not [name for name in conditions_for(design_named("2-L")) if name.startswith("reach")]


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
        assert condition.startswith(("several", "compare")) or target_of(episode, design)
    assert len(draw(design, "train", 3).blocks) == 6


class Crowded(ArenaConfig):
    block_separation_m: ClassVar[float] = 0.9


def test_too_many_blocks_are_rejected() -> None:
    design = design_named("3-C")
    crowded = Crowded(**CONFIG.fields())
    with pytest.raises(ArenaError, match="4 blocks"):
        generate(crowded, design, condition_named("train", design), 0, 0)


def scene(episode: Episode) -> list[object]:
    """Everything about an episode, to the micrometre and microradian."""
    blocks = [
        (*sorted(block.kind.words), *(round(x, 6) for x in (block.x, block.y, block.yaw)))
        for block in episode.blocks
    ]
    edges = [round(block.edge_m, 6) for block in episode.blocks if block.edge_m]
    start = [round(angle, 6) for angle in episode.arm_start]
    return [str(episode.goal), start, blocks, *edges]


@pytest.mark.parametrize(
    ("design", "conditions", "digest"),
    [
        ("2-L", "train", "b04e40a99b7f3c8e"),
        ("3-D", "eval", "53943915d479a8a5"),
        ("3-D", "not-color", "7540b2ca4c08d139"),
        ("3-D", "depth-3", "cc59371b599ce811"),
        ("3-D", "train only-color not-shape blocks-8 ignore-new chain-4 reach-new-shape several-2 "
         "several-all compare compare-8", "0c99a6dea9c078a6"),
        ("3-D-avoid", "train avoid avoid-or avoid-not finite-1", "e2f8b5b5b51f6354"),
        ("3-D-relations", "train train-above eval-combinations", "42c485c8db8c88a9"),
        ("sizes", "train only-color compare-size compare-size-8 compare-size-unseen eval-unseen",
         "462246e7b77545f9"),
        ("push-2", "train eval pairs reach moved-or target-or depth-3 target-not-color "
         "moved-not-shape blocks-3", "400166744cfba532"),
        ("push-3D", "train pairs-eval moved-new-color target-new-shape target-only-color "
         "moved-only-shape", "29e27e0a854f012c"),
        ("push-2-pairs", "train", "4eb577e3440a3314"),
    ],
)  # fmt: skip
def test_episodes_of_a_seed_never_change(design, conditions, digest):
    """Another order of draws would change every published result."""
    places = product(range(2), range(3))
    chosen = product(conditions.split(), places)
    drawn = [scene(draw(design_named(design), name, *place)) for name, place in chosen]
    assert hashlib.sha256(json.dumps(drawn).encode()).hexdigest()[:16] == digest


def depth(expression: Expression) -> int:
    match expression:
        case Word():
            return 1
        case Not(operand):
            return 1 + depth(operand)
        case And(operands) | Or(operands):
            return 1 + max(map(depth, operands))


def named(expression: Expression) -> tuple[bool, ...]:
    return satisfying(Program(expression), [kind.words for kind in THREE_D.pool], None)


@pytest.mark.parametrize("deep", DEPTHS)
def test_deep_programs_have_their_depth_and_every_part_matters(deep: int) -> None:
    trained = {named(And((Word(kind["color"]), Word(kind["shape"])))) for kind in THREE_D.train}
    texts = set()
    for index in range(25):
        episode = generate(CONFIG, THREE_D, condition_named(f"depth-{deep}", THREE_D), 0, index)
        assert len(episode.blocks) == 4
        program = episode.program
        texts.add(str(program))
        assert depth(program.target) == deep
        assert named(program.target) not in trained
        for node in walk(program.target):
            assert len(set(named(node))) == 2
            if isinstance(node, And | Or):
                assert all(named(operand) != named(node) for operand in node.operands)
            if isinstance(node, Not):
                assert not isinstance(node.operand, Not)
    assert len(texts) > 20


def test_an_impossible_deep_program_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pa_ros.arena.drawn_programs.TRIES", 100)
    words = Vocabulary.of(shape=("CUBE",), color=("RED", "BLUE"))
    values = {"color": ("RED", "BLUE"), "shape": ("CUBE",)}
    row = Design("row", values, words, (Kind(color="RED", shape="CUBE"),), n_blocks=2)
    with pytest.raises(ArenaError, match="programs 3 deep for design row"):
        DeepPrograms(row, 3).draw(row.pool[1], 1, np.random.default_rng(0))
