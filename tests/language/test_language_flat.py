"""The flat form: registers, sharing, and the cache."""

from __future__ import annotations

import pytest

from pa_ros.language import FlatProgram, ProgramError, Vocabulary, compile_program, parse
from pa_ros.language.flat import AND, NOT, OR

VOCABULARY = Vocabulary.of(
    shape=("CUBE", "SPHERE"), color=("RED", "BLUE")
)  # rows 0 to 3; HAND is register 4


def flat(target: str) -> FlatProgram:
    return compile_program(parse(f"NEAR(HAND, {target})", VOCABULARY), VOCABULARY)


@pytest.mark.parametrize(
    ("target", "instructions"),
    [
        ("BLUE", [(OR, 4, 3)]),
        ("AND(RED, CUBE)", [(AND, 2, 0), (OR, 4, 5)]),
        ("NOT(RED)", [(NOT, 2, 2), (OR, 4, 5)]),
        ("OR(CUBE, RED, BLUE)", [(OR, 0, 2), (OR, 5, 3), (OR, 4, 6)]),
        (
            "OR(AND(NOT(RED), CUBE), AND(NOT(RED), SPHERE))",
            [(NOT, 2, 2), (AND, 5, 0), (AND, 5, 1), (OR, 6, 7), (OR, 4, 8)],
        ),
    ],
)
def test_instructions(target: str, instructions: list[tuple[int, int, int]]) -> None:
    program = flat(target)
    assert list(zip(program.op, program.a, program.b, strict=True)) == instructions
    assert len(program) == len(instructions)


def test_equal_programs_are_compiled_alike() -> None:
    assert flat("AND(RED, CUBE)") == flat("AND(RED,\n  CUBE)")


def test_the_rows_are_the_vocabularys() -> None:
    other = Vocabulary.of(shape=("SPHERE", "CUBE"), color=("BLUE", "RED"))
    program = parse("NEAR(HAND, AND(RED, CUBE))", VOCABULARY)
    assert compile_program(program, other).a == (3, 4)


def test_a_program_of_another_vocabulary_is_refused() -> None:
    program = parse("NEAR(HAND, AND(RED, CUBE))", VOCABULARY)
    with pytest.raises(ProgramError) as caught:
        compile_program(program, Vocabulary.of(shape=("SPHERE",), color=("RED",)))
    assert (caught.value.code, caught.value.received) == ("program.unknown_word", "'CUBE'")
