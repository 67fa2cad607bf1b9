"""Crisp and soft evaluation on examples small enough to check by hand."""

from __future__ import annotations

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.language import (
    Not,
    Program,
    ProgramError,
    Vocabulary,
    Word,
    parse,
    relevance,
    require_target,
    satisfying,
)

VOCABULARY = Vocabulary.of(shape=("CUBE", "SPHERE"), color=("RED", "BLUE"))
PHI = [  # [V][N]: hand, first block, second block
    [0.5, 0.75, 0.0],  # CUBE
    [0.5, 0.25, 1.0],  # SPHERE
    [0.5, 0.5, 0.125],  # RED
    [0.5, 0.5, 0.875],  # BLUE
]


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
    program = parse(f"NEAR(HAND, {target})", VOCABULARY)
    assert relevance(program, PHI, VOCABULARY.row, hand_index=0) == expected


def test_the_hand_may_be_any_column() -> None:
    program = parse("NEAR(HAND, RED)", VOCABULARY)
    assert relevance(program, PHI, VOCABULARY.row, hand_index=2) == [0.5, 0.5, 1.0]
    assert satisfying(Program(Not(Word("RED"))), [set(), set(), {"RED"}], 1) == (True, False, False)


def test_a_negation_never_names_the_hand() -> None:
    world = [set(), {"RED", "CUBE"}, {"BLUE", "CUBE"}]
    assert satisfying(parse("NEAR(HAND, NOT(RED))", VOCABULARY), world, 0) == (False, False, True)


def test_a_world_without_the_hand() -> None:
    world = [{"RED"}, {"BLUE"}]
    assert satisfying(parse("NEAR(HAND, NOT(RED))", VOCABULARY), world, None) == (False, True)


@pytest.mark.parametrize("hand_index", [-1, 3])
def test_a_hand_that_is_not_there_is_refused(hand_index: int) -> None:
    program = parse("NEAR(HAND, RED)", VOCABULARY)
    with pytest.raises(ConfigError, match=f"one of 3 objects, got {hand_index}"):
        satisfying(program, [set(), {"RED"}, set()], hand_index)
    with pytest.raises(ConfigError, match=f"one of 3 objects, got {hand_index}"):
        relevance(program, PHI, VOCABULARY.row, hand_index)


def test_a_target_that_is_absent_is_refused_with_what_is_present() -> None:
    program = parse("NEAR(HAND, AND(BLUE, SPHERE))", VOCABULARY)
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


def test_a_program_of_another_vocabulary_is_refused() -> None:
    program = parse("NEAR(HAND, AND(RED, D))", Vocabulary.of(shape=("CUBE",), color=("RED", "D")))
    with pytest.raises(ProgramError) as caught:
        relevance(program, PHI, VOCABULARY.row, 0)
    assert (caught.value.code, caught.value.position) == ("program.unknown_word", 20)
