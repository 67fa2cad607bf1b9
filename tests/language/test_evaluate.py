"""What programs mean, and their instructions, on examples that can be checked by hand."""

from __future__ import annotations

import pytest

from pa_ros.language import (
    Not,
    Program,
    ProgramError,
    Vocabulary,
    Word,
    compile_program,
    parse,
    relevance,
    require_target,
    satisfying,
)
from pa_ros.language.flat import AND, NOT, OR

# Rows 0 to 3 of Φ; HAND is register 4.
VOCABULARY = Vocabulary.of(shape=("CUBE", "SPHERE"), color=("RED", "BLUE"))
PHI = [  # [V][N]: hand, first block, second block
    [0.5, 0.75, 0.0],  # CUBE
    [0.5, 0.25, 1.0],  # SPHERE
    [0.5, 0.5, 0.125],  # RED
    [0.5, 0.5, 0.875],  # BLUE
]


def near(target: str) -> Program:
    return parse(f"NEAR(HAND, {target})", VOCABULARY)


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ("RED", [1.0, 0.5, 0.125]),
        ("NOT(RED)", [1.0, 0.5, 0.875]),
        ("AND(RED, CUBE)", [1.0, 0.375, 0.0]),
        ("OR(RED, CUBE)", [1.0, 0.875, 0.125]),
        ("AND(RED, RED, RED)", [1.0, 0.125, 0.001953125]),
        ("OR(AND(RED, CUBE), SPHERE)", [1.0, 0.53125, 1.0]),
    ],
)
def test_relevance_by_hand(target: str, expected: list[float]) -> None:
    assert relevance(near(target), PHI, VOCABULARY.row, hand_index=0) == expected


def test_the_hand_may_be_any_column() -> None:
    assert relevance(near("RED"), PHI, VOCABULARY.row, hand_index=2) == [0.5, 0.5, 1.0]
    assert satisfying(Program(Not(Word("RED"))), [set(), set(), {"RED"}], 1) == (True, False, False)


def test_a_negation_never_names_the_hand() -> None:
    world = [set(), {"RED", "CUBE"}, {"BLUE", "CUBE"}]
    assert satisfying(near("NOT(RED)"), world, 0) == (False, False, True)
    assert satisfying(near("NOT(RED)"), world[1:], None) == (False, True)


def test_an_absent_target_is_rejected_with_the_present_objects() -> None:
    program = near("AND(BLUE, SPHERE)")
    world = [set(), {"RED", "CUBE"}, {"BLUE", "CUBE"}]
    with pytest.raises(ProgramError) as caught:
        require_target(program, world, 0)
    assert caught.value.code == "program.names_nothing"
    assert str(caught.value) == (
        "column 12: no such object: expected an object of the scene (CUBE RED or BLUE CUBE), "
        "received AND(BLUE, SPHERE)\n"
        "  NEAR(HAND, AND(BLUE, SPHERE))\n"
        "             ^~~~~~~~~~~~~~~~~"
    )
    assert require_target(program, [*world, {"BLUE", "SPHERE"}], 0) == (False, False, False, True)
    with pytest.raises(ProgramError, match="it is empty"):
        require_target(program, [set()], 0)


@pytest.mark.parametrize(
    ("target", "instructions"),
    [
        ("BLUE", [(OR, 4, 3)]),
        ("AND(RED,\n CUBE)", [(AND, 2, 0), (OR, 4, 5)]),
        ("NOT(RED)", [(NOT, 2, 2), (OR, 4, 5)]),
        ("OR(CUBE, RED, BLUE)", [(OR, 0, 2), (OR, 5, 3), (OR, 4, 6)]),
        (
            "OR(AND(NOT(RED), CUBE), AND(NOT(RED), SPHERE))",
            [(NOT, 2, 2), (AND, 5, 0), (AND, 5, 1), (OR, 6, 7), (OR, 4, 8)],
        ),
    ],
)
def test_instructions(target: str, instructions: list[tuple[int, int, int]]) -> None:
    program = compile_program(near(target), VOCABULARY)
    assert list(zip(program.op, program.a, program.b, strict=True)) == instructions


def test_registers_follow_the_rows_of_the_vocabulary() -> None:
    other = Vocabulary.of(shape=("SPHERE", "CUBE"), color=("BLUE", "RED"))
    assert compile_program(near("AND(RED, CUBE)"), other).a == (3, 4)
