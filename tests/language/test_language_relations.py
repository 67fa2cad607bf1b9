"""Relations in the language: parsed, printed, told apart, refused with the known ones."""

from __future__ import annotations

import numpy as np
import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.language import Program, ProgramError, Vocabulary, Word, compile_program, parse
from pa_ros.language.evaluate import require_target
from pa_ros.language.limits import MAX_RELATIONS
from pa_ros.world.programs import ProgramTable

WORDS = Vocabulary.of(shape=("CUBE", "SPHERE"), color=("RED", "BLUE"))
BOTH = WORDS.asking("NEAR", "ABOVE", "LEFT_OF")


def test_a_program_says_which_relation_it_asks_for() -> None:
    program = parse(" LEFT_OF( HAND,AND(RED,CUBE) )", BOTH)
    assert str(program) == "LEFT_OF(HAND, AND(RED, CUBE))" and program.relation == "LEFT_OF"
    assert parse(str(program), BOTH) == program
    assert program != parse("NEAR(HAND, AND(RED, CUBE))", BOTH)
    assert program.words == ("RED", "CUBE")
    assert Program(Word("RED")).relation == "NEAR"


@pytest.mark.parametrize(
    ("text", "code", "position", "shown"),
    [
        (
            "BELOW(HAND, RED)",
            "program.unknown_word",
            0,
            "expected NEAR, ABOVE or LEFT_OF, received 'BELOW'",
        ),
        ("ABOV(HAND, RED)", "program.unknown_word", 0, "did you mean ABOVE?"),
        ("above(HAND, RED)", "program.wrong_case", 0, "expected ABOVE, received 'above'"),
        ("RED(HAND, RED)", "program.syntax", 0, "expected NEAR, ABOVE or LEFT_OF, received 'RED'"),
        ("ABOVE(HAND, NEAR)", "program.syntax", 12, "(NEAR is not a property)"),
        ("ABOVE(HAND, RED, BLUE)", "program.arity", 0, "expected 2 arguments to ABOVE, received 3"),
        ("ABOVE()", "program.arity", 0, "expected 2 arguments to ABOVE, received 0"),
        (" ", "program.empty", 0, "such as NEAR(HAND, CUBE)"),
    ],
)
def test_what_is_no_relation_is_refused_with_the_known_ones(
    text: str, code: str, position: int, shown: str
) -> None:
    with pytest.raises(ProgramError) as caught:
        parse(text, BOTH)
    assert (caught.value.code, caught.value.position) == (code, position)
    assert shown in str(caught.value)


def test_a_relation_of_another_world_is_unknown() -> None:
    with pytest.raises(ProgramError, match="expected NEAR, received 'ABOVE'"):
        parse("ABOVE(HAND, RED)", WORDS)
    with pytest.raises(ProgramError, match="column 1: unknown word: expected NEAR"):
        compile_program(Program(Word("RED"), "ABOVE"), WORDS)


def test_a_table_knows_the_relation_of_each_program() -> None:
    table = ProgramTable(BOTH)
    rows = [table.add(parse(f"{name}(HAND, RED)", BOTH)) for name in ("LEFT_OF", "NEAR", "LEFT_OF")]
    assert rows == [0, 1, 0] and table.relations().tolist() == [2, 0]
    op, a, b = table.arrays()
    assert all(np.array_equal(x[0], x[1]) for x in (op, a, b))  # p is the same


def test_what_is_not_there_is_pointed_at_behind_any_relation() -> None:
    with pytest.raises(ProgramError) as caught:
        require_target(parse("LEFT_OF(HAND, RED)", BOTH), [{"BLUE"}], None)
    assert caught.value.position == len("LEFT_OF(HAND, ")


@pytest.mark.parametrize(
    ("relations", "why"),
    [
        ((), "expected 1 to 16 relations"),
        (tuple(f"R{i}" for i in range(MAX_RELATIONS + 1)), "expected 1 to 16 relations"),
        (("NEAR", "NEAR"), "'NEAR' is reserved or named twice"),
        (("RED",), "'RED' is reserved or named twice"),
        (("HAND",), "'HAND' is reserved"),
        (("above",), "upper-case ASCII word, got 'above'"),
    ],
)
def test_relations_that_cannot_be_asked_for_are_refused(
    relations: tuple[str, ...], why: str
) -> None:
    with pytest.raises(ConfigError, match=why):
        WORDS.asking(*relations)
