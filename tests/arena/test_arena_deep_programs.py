"""Longer programs: as deep as asked, no part idle, none that means what training taught."""

import numpy as np
import pytest

from pa_ros.arena import ArenaError, condition_named, design_named, generate, preset_named
from pa_ros.arena.conditions import DEPTHS, DeepPrograms
from pa_ros.arena.designs import Design, Kind
from pa_ros.language import And, Expression, Not, Or, Program, Vocabulary, Word, satisfying
from pa_ros.language.syntax import walk

FAST, THREE_D = preset_named("fast"), design_named("3-D")


def depth(expression: Expression) -> int:
    match expression:
        case Word():
            return 1
        case Not(operand):
            return 1 + depth(operand)
        case And(operands) | Or(operands):
            return 1 + max(map(depth, operands))


def named(expression: Expression, design: Design = THREE_D) -> tuple[bool, ...]:
    return satisfying(Program(expression), [kind.words for kind in design.pool], None)


@pytest.mark.parametrize("deep", DEPTHS)
def test_programs_are_deep_and_no_part_is_idle(deep: int) -> None:
    trained = {named(And((Word(kind["color"]), Word(kind["shape"])))) for kind in THREE_D.train}
    texts = set()
    for index in range(25):
        episode = generate(FAST, THREE_D, condition_named(f"depth-{deep}", THREE_D), 0, index)
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


def test_what_cannot_be_drawn_is_refused() -> None:
    words = Vocabulary.of(shape=("CUBE",), color=("RED", "BLUE"))
    values = {"color": ("RED", "BLUE"), "shape": ("CUBE",)}
    row = Design("row", values, words, (Kind(color="RED", shape="CUBE"),), n_blocks=2)
    with pytest.raises(ArenaError, match="programs 3 deep for design row"):
        DeepPrograms(row, 3).draw(row.pool[1], 1, np.random.default_rng(0))
