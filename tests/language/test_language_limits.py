"""Hostile text is refused at once: the largest programs allowed, and what lies beyond."""

from __future__ import annotations

import time

import pytest

from pa_ros.language import Program, ProgramError, Vocabulary, compile_program, parse
from pa_ros.language.limits import MAX_DEPTH, MAX_LENGTH, MAX_NODES
from pa_ros.language.syntax import walk

VOCABULARY = Vocabulary.of(
    shape=("CUBE", "SPHERE", "CYLINDER", "C"), color=("RED", "GREEN", "BLUE", "A", "B")
)
REFUSAL_S = 0.25  # bound on a refusal's wall-clock time; generous for a busy machine


def near(target: str) -> str:
    return f"NEAR(HAND, {target})"


def nested(operators: int) -> str:
    return near("NOT(" * operators + "A" + ")" * operators)


HOSTILE = {
    "1 MB of letters": ("A" * 1_000_000, "program.too_long"),
    "1 MB of spaces": (" " * 1_000_000, "program.too_long"),
    "1 MB of lines": ("\n" * 1_000_000, "program.too_long"),
    "1 MB of non-ASCII": ("é" * 1_000_000, "program.too_long"),
    "10,000 nested NOTs": (nested(10_000), "program.too_long"),
    "10,000 operands": (near(f"AND({', '.join(['A'] * 10_000)})"), "program.too_long"),
    "nested as deep as the length allows": (nested(800), "program.too_deep"),
    "never closed": (near("NOT(" * 1_000)[:MAX_LENGTH], "program.too_deep"),
    "ANDs on the left": ("NEAR(HAND, " + "AND(" * 1_000, "program.too_deep"),
    "ANDs on the right": ("NEAR(HAND, " + "AND(A," * 600, "program.too_deep"),
    "one level too deep": (nested(MAX_DEPTH), "program.too_deep"),
    "one node too many": (near(f"AND({','.join(['A'] * MAX_NODES)})"), "program.too_large"),
    "one long word": (near("A" * 4_000), "program.unknown_word"),
    "opening signs": ("(" * MAX_LENGTH, "program.syntax"),
    "commas": ("NEAR(HAND" + "," * 4_000, "program.syntax"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_text_is_refused_at_once(name: str) -> None:
    text, code = HOSTILE[name]
    started = time.perf_counter()
    with pytest.raises(ProgramError) as caught:
        parse(text, VOCABULARY)
    shown = str(caught.value)
    assert time.perf_counter() - started < REFUSAL_S
    assert caught.value.code == code
    assert len(shown) < 500 and shown.isascii()


def test_the_largest_programs_are_accepted() -> None:
    deepest = parse(nested(MAX_DEPTH - 1), VOCABULARY)
    assert len(compile_program(deepest, VOCABULARY)) == MAX_DEPTH
    widest = parse(near(f"AND({','.join(['A'] * (MAX_NODES - 1))})"), VOCABULARY)
    assert sum(1 for _ in walk(widest.target)) == MAX_NODES
    assert len(compile_program(widest, VOCABULARY)) == MAX_NODES - 1
    text = near("RED")
    padded = text.ljust(MAX_LENGTH)
    assert str(parse(padded, VOCABULARY)) == text
    with pytest.raises(ProgramError, match="too long"):
        parse(padded + " ", VOCABULARY)


def test_the_canonical_form_has_to_fit_too() -> None:
    """Else a program would be accepted whose own printed form is refused."""
    word = "W" * 30
    text = "NEAR(HAND,AND(" + ",".join([word] * 130) + "))"
    assert len(text) <= MAX_LENGTH
    with pytest.raises(ProgramError, match=r"received 41\d\d in canonical form") as caught:
        parse(text, Vocabulary.of(shape=(word,), color=("RED",)))
    assert caught.value.code == "program.too_long"


def test_the_papers_largest_program_is_as_small_as_the_limits_say() -> None:
    program: Program = parse(
        "NEAR(HAND, AND(OR(NOT(OR(RED, BLUE, GREEN)), OR(A, B)),"
        " OR(NOT(OR(CUBE, SPHERE, CYLINDER)), C)))",
        VOCABULARY,
    )
    assert len(str(program)) == 96
    assert sum(1 for _ in walk(program.target)) == 17
