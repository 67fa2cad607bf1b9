"""Laws of the language, on generated programs and worlds."""

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from helpers import programs
from helpers.programs import VOCABULARY
from pa_ros.language import MIN_MAX, And, Expression, Not, Or, Program, Word, parse, relevance
from pa_ros.language.parser import MAX_DEPTH, MAX_LENGTH, MAX_NODES
from pa_ros.language.syntax import walk

HAND, OBJECTS = 0, 4


expressions = programs.expressions(max_leaves=20)
rows = st.lists(st.floats(0, 1), min_size=OBJECTS, max_size=OBJECTS)
soft = st.lists(rows, min_size=len(VOCABULARY.words), max_size=len(VOCABULARY.words))
space = st.text(" \t\r\n\f\v", max_size=3)


def degrees(expression: Expression, phi: list[list[float]]) -> list[float]:
    """Soft membership of the blocks."""
    return relevance(Program(expression), phi, VOCABULARY.row, HAND)[1:]


@given(expressions)
def test_parsing_the_printed_form_gives_an_equal_program(target: Expression) -> None:
    program = Program(target)
    assume(sum(1 for _ in walk(target)) <= MAX_NODES and depth(target) <= MAX_DEPTH)
    parsed = parse(str(program), VOCABULARY)
    assert parsed == program
    assert hash(parsed) == hash(program)


@given(expressions, st.data())
def test_white_space_is_ignored(target: Expression, data: st.DataObject) -> None:
    text = str(Program(target)).replace(" ", "")
    loose = "".join(data.draw(space) + c + data.draw(space) if c in "()," else c for c in text)
    assume(len(loose) <= MAX_LENGTH)
    assert str(parse(loose, VOCABULARY)) == str(Program(target))


@given(expressions, expressions, soft)
def test_de_morgan_and_double_negation(x: Expression, y: Expression, phi: list[list[float]]):
    either = degrees(Or((x, y)), phi)
    neither_fails = degrees(Not(And((Not(x), Not(y)))), phi)
    assert either == pytest.approx(neither_fails, abs=1e-12)
    assert degrees(Not(Not(x)), phi) == pytest.approx(degrees(x, phi), abs=1e-12)
    both = degrees(And((x, y)), phi)
    assert both == pytest.approx(degrees(Not(Or((Not(x), Not(y)))), phi), abs=1e-12)


@given(expressions, expressions, expressions, soft)
def test_min_and_max_make_a_lattice(x, y, z, phi) -> None:
    """Idempotence, absorption, distribution and De Morgan, to rounding of 1 - (1 - x)."""
    equal: list[tuple[Expression, Expression]] = [
        (x, And((x, x))),
        (x, Or((x, x))),
        (x, Or((x, And((x, y))))),
        (x, And((x, Or((x, y))))),
        (And((x, Or((y, z)))), Or((And((x, y)), And((x, z))))),
        (Or((x, And((y, z)))), And((Or((x, y)), Or((x, z))))),
        (And((x, y)), And((y, x))),
        (And((And((x, y)), z)), And((x, And((y, z))))),
        (Or((x, y)), Not(And((Not(x), Not(y))))),
    ]
    for left, right in equal:
        one, other = (
            relevance(Program(side), phi, VOCABULARY.row, HAND, MIN_MAX) for side in (left, right)
        )
        assert one == pytest.approx(other, abs=1e-12)


@given(st.lists(expressions, min_size=3, max_size=5), soft)
def test_many_operands_equal_pairs_from_the_left(operands, phi) -> None:
    for operator in (And, Or):
        pairs = operands[0]
        for operand in operands[1:]:
            pairs = operator((pairs, operand))
        assert degrees(operator(tuple(operands)), phi) == degrees(pairs, phi)


@given(expressions, soft)
def test_relevance_stays_in_the_unit_interval(x: Expression, phi: list[list[float]]) -> None:
    p = relevance(Program(x), phi, VOCABULARY.row, HAND)
    assert all(-1e-12 <= degree <= 1 + 1e-12 for degree in p)
    assert p[HAND] == pytest.approx(1.0, abs=1e-12)


def depth(expression: Expression) -> int:
    if isinstance(expression, Word):
        return 1
    parts = (expression.operand,) if isinstance(expression, Not) else expression.operands
    return 1 + max(map(depth, parts))
