"""What programs mean, and their instructions, on examples that can be checked by hand."""

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
    role_relevance,
    roles,
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


def test_relevance_of_a_program_that_moves_objects_by_hand() -> None:
    pushes, row = Program(Word("BLUE"), moved=Word("RED")), VOCABULARY.row
    blue = [0.0, 0.5, 0.875]
    assert role_relevance(pushes, PHI, row, 0) == ([0.0, 0.5, 0.125], blue)
    assert role_relevance(pushes, PHI, row, 0, bodiless=("SPHERE",)) == ([0.0, 0.375, 0.0], blue)
    assert role_relevance(near("BLUE"), PHI, row, 0, bodiless=("CUBE",)) == ([1.0, 0.0, 0.0], blue)
    assert relevance(pushes, PHI, row, 0) == [1.0, 0.75, 0.890625]
    with pytest.raises(ProgramError, match="unknown word: expected CUBE, .* received 'GREEN'"):
        relevance(Program(Word("GREEN")), PHI, row, 0)


def test_the_hand_may_be_any_column() -> None:
    assert relevance(near("RED"), PHI, VOCABULARY.row, hand_index=2) == [0.5, 0.5, 1.0]
    assert satisfying(Program(Not(Word("RED"))), [set(), set(), {"RED"}], 1) == (True, False, False)


def test_a_negation_never_names_the_hand() -> None:
    world = [set(), {"RED", "CUBE"}, {"BLUE", "CUBE"}]
    assert satisfying(near("NOT(RED)"), world, 0) == (False, False, True)
    assert satisfying(near("NOT(RED)"), world[1:], None) == (False, True)


def test_an_absent_target_is_rejected_with_the_present_objects() -> None:
    program = near("AND(BLUE, SPHERE)")
    world = [(), ("RED", "CUBE"), ("BLUE", "CUBE")]
    with pytest.raises(ProgramError) as caught:
        require_target(program, world, 0)
    assert caught.value.code == "program.names_nothing"
    assert str(caught.value) == (
        "column 12: no such object: expected an object of the scene (RED CUBE or BLUE CUBE), "
        "received AND(BLUE, SPHERE)\n"
        "  NEAR(HAND, AND(BLUE, SPHERE))\n"
        "             ^~~~~~~~~~~~~~~~~"
    )
    require_target(program, [*world, ("BLUE", "SPHERE")], 0)
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


MOVING = Vocabulary.of(shape=("CUBE", "PLACE"), color=("RED", "BLUE")).moving("PLACE")
SCENE = [set(), {"RED", "CUBE"}, {"BLUE", "CUBE"}, {"RED", "PLACE"}, {"BLUE", "PLACE"}]


@pytest.mark.parametrize(
    ("text", "moved", "target"),
    [
        ("NEAR(RED, BLUE)", [1], [2, 4]),
        ("NEAR(NOT(RED), PLACE)", [2], [3, 4]),
        ("NEAR(CUBE, CUBE)", [1, 2], [1, 2]),
        ("NEAR(HAND, PLACE)", [0], [3, 4]),
        ("NEAR(BLUE, HAND)", [2], [0]),
    ],
)
def test_the_two_sets_of_a_program(text: str, moved: list[int], target: list[int]) -> None:
    """Only HAND contains the hand, and places cannot be moved."""
    program = parse(text, MOVING)
    assert str(program) == text
    sets = roles(program, SCENE, 0, MOVING.bodiless)
    assert [[i for i, named in enumerate(one) if named] for one in sets] == [moved, target]
    named = satisfying(program, SCENE, 0, MOVING.bodiless)
    assert [i for i, one in enumerate(named) if one] == sorted({*moved, *target} - {0})
    require_target(program, SCENE, 0, MOVING.bodiless)


@pytest.mark.parametrize(
    ("text", "code", "caret"),
    [
        ("NEAR(AND(RED, CUBE), AND(CUBE, NOT(BLUE)))", "itself", (21, 41)),
        ("NEAR(AND(RED, PLACE), BLUE)", "needs_body", (5, 20)),
        ("NEAR(AND(RED, BLUE), PLACE)", "names_nothing", (5, 19)),
        ("NEAR(RED, AND(RED, BLUE))", "names_nothing", (10, 24)),
        ("NEAR(LEFTMOST(AND(RED, BLUE)), PLACE)", "names_nothing", (14, 28)),
        ("NEAR(RED, LEFTMOST(AND(RED, BLUE)))", "names_nothing", (19, 33)),
    ],
)
def test_programs_that_cannot_hold_are_rejected(text: str, code: str, caret: tuple[int, int]):
    with pytest.raises(ProgramError) as caught:
        require_target(parse(text, MOVING), SCENE, 0, MOVING.bodiless)
    assert (caught.value.code, tuple(caught.value.span)) == (f"program.{code}", caret)


def test_instructions_of_a_program_that_moves_an_object() -> None:
    """What is moved has a body, and p = OR(HAND, OR(p1, p2)); the hand's register is 4."""
    code = compile_program(parse("NEAR(RED, AND(BLUE, PLACE))", MOVING), MOVING)
    instructions = [(NOT, 1, 1), (AND, 2, 5), (AND, 3, 1), (OR, 6, 7), (OR, 4, 8)]
    assert list(zip(code.op, code.a, code.b, strict=True)) == instructions
    assert (code.moved, code.target) == (6, 7)
    reaching = compile_program(parse("NEAR(HAND, RED)", MOVING), MOVING)
    assert reaching == compile_program(near("RED"), VOCABULARY)
    assert (reaching.moved, reaching.target) == (4, 2)


def test_registers_follow_the_rows_of_the_vocabulary() -> None:
    other = Vocabulary.of(shape=("SPHERE", "CUBE"), color=("BLUE", "RED"))
    assert compile_program(near("AND(RED, CUBE)"), other).a == (3, 4)


def test_a_program_that_networks_have_no_input_for_does_not_compile() -> None:
    """It would be read as another program."""
    red, blue = Word("RED"), Word("BLUE")
    moves, avoids = Program(red, moved=blue), Program(red, avoided=blue)
    plain = Vocabulary.of(shape=("CUBE",), color=("RED", "BLUE"))
    for vocabulary, program, code, part in (
        (plain, moves, "program.moves", "BLUE"),
        (plain.avoiding(), moves, "program.moves", "BLUE"),
        (plain, avoids, "program.avoids", "AVOID"),
        (plain.moving(), Program(red, moved=blue, avoided=red), "program.avoids", "AVOID"),
    ):
        with pytest.raises(ProgramError) as caught:
            compile_program(program, vocabulary)
        assert (caught.value.code, caught.value.source) == (code, str(program))
        assert str(program)[slice(*caught.value.span)] == part
    assert compile_program(moves, plain.moving()).moved == plain.row["BLUE"]
    assert compile_program(avoids, plain.avoiding()).avoided == plain.row["BLUE"]
