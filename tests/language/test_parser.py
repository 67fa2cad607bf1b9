"""Rejected programs: the message with its caret, the limits, and the relations of a vocabulary."""

import time

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.language import Program, ProgramError, Vocabulary, Word, compile_program, parse
from pa_ros.language.errors import EXCERPT_WIDTH, SHOWN_CHARACTERS, SHOWN_WORDS, one_of
from pa_ros.language.parser import MAX_DEPTH, MAX_LENGTH, MAX_NODES
from pa_ros.language.syntax import Span, walk

WORDS = Vocabulary.of(shape=("CUBE", "SPHERE"), color=("RED", "BLUE"))
MOVING = WORDS.moving("SPHERE")
SEVERAL = WORDS.asking("NEAR", "ABOVE", "LEFT_OF")
KNOWN = "NEAR, ABOVE, LEFT_OF, THEN, ALL or AVOID, received"
REJECTION_S = 0.25  # generous for a busy machine


def rejection(text: str, vocabulary: Vocabulary = WORDS) -> ProgramError:
    with pytest.raises(ProgramError) as caught:
        parse(text, vocabulary)
    return caught.value


def near(target: str) -> str:
    return f"NEAR(HAND, {target})"


def nested(operators: int) -> str:
    return near("NOT(" * operators + "RED" + ")" * operators)


def test_the_message_has_a_caret_under_the_word_and_the_error_has_its_parts() -> None:
    error = rejection("NEAR(HAND, AND(RED, CUBBE))")
    assert str(error) == (
        "column 21: unknown word: expected CUBE, SPHERE, RED, BLUE, AND, OR or NOT, "
        "received 'CUBBE'; did you mean CUBE?\n"
        "  NEAR(HAND, AND(RED, CUBBE))\n"
        "                      ^~~~~"
    )
    assert (error.span, error.position) == (Span(20, 25), 20)
    assert (error.received, error.suggestion) == ("'CUBBE'", "CUBE")
    assert error.message == str(error).split("\n")[0]


@pytest.mark.parametrize(
    ("text", "shown", "caret"),
    [
        ("NEAR(HAND,\r\n\tAND(RED,\n     GREN))", "       GREN))", "       ^~~~"),
        ("NEAR(HAND, NOT(RED,\n BLUE))", "  NEAR(HAND, NOT(RED,", "             ^~~~~~~~"),
        ("NEAR(HAND, RED  \n", "  NEAR(HAND, RED  ", "                ^"),
    ],
)
def test_only_the_line_with_the_fault_is_shown(text: str, shown: str, caret: str) -> None:
    assert str(rejection(text)).split("\n")[1:] == [shown, caret]


def test_a_long_line_is_cut_to_a_window_around_the_caret() -> None:
    text = f"NEAR(HAND, AND({'RED, ' * 60}GREEEN, {'RED, ' * 60}RED))"
    shown, caret = str(rejection(text)).split("\n")[1:]
    assert shown.startswith("  ...") and shown.endswith("...")
    assert len(shown) == EXCERPT_WIDTH + 8
    start = caret.index("^")
    assert shown[start : start + len("GREEEN")] == "GREEEN"
    assert caret[start:] == "^~~~~~"


def test_long_lists_and_words_are_cut() -> None:
    many = Vocabulary.of(shape=("CUBE",), color=tuple(f"COLOR{i}" for i in range(200)))
    message = rejection(f"NEAR(HAND, {'X' * 300})", many).message
    assert f"or 188 more, received '{'X' * (SHOWN_CHARACTERS - 3)}...'" in message
    assert "X" * SHOWN_CHARACTERS in rejection(near("X" * SHOWN_CHARACTERS), many).received
    assert one_of("A" * SHOWN_WORDS) == "A, " * (SHOWN_WORDS - 2) + "A or A"


HOSTILE = {
    "1 MB of letters": ("A" * 1_000_000, "program.too_long", "A"),
    "nested as deep as the length allows": (nested(800), "program.too_deep", "NOT"),
    "never closed": (near("NOT(" * 1_000)[:MAX_LENGTH], "program.too_deep", "NOT"),
    "ANDs on the right": ("NEAR(HAND, " + "AND(RED," * 500, "program.too_deep", "RED"),
    "one level too deep": (nested(MAX_DEPTH), "program.too_deep", "RED"),
    "one node too many": (
        near(f"AND({','.join(['RED'] * MAX_NODES)})"),
        "program.too_large",
        "RED",
    ),
    "one long word": (near("A" * 4_000), "program.unknown_word", "A" * 4_000),
    "opening signs": ("(" * MAX_LENGTH, "program.syntax", "("),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_text_is_rejected_quickly_with_a_short_message(name: str) -> None:
    text, code, part = HOSTILE[name]
    started = time.perf_counter()
    error = rejection(text)
    shown = str(error)
    assert time.perf_counter() - started < REJECTION_S
    assert (error.code, text[slice(*error.span)]) == (code, part)
    assert error.position == MAX_LENGTH or len(text) <= MAX_LENGTH
    assert len(shown) < 500 and shown.isascii()


def test_the_largest_programs_are_accepted() -> None:
    deepest = parse(nested(MAX_DEPTH - 1), WORDS)
    assert len(compile_program(deepest, WORDS).op) == MAX_DEPTH
    widest = parse(near(f"AND({','.join(['RED'] * (MAX_NODES - 1))})"), WORDS)
    assert sum(1 for _ in walk(widest.target)) == MAX_NODES
    assert len(compile_program(widest, WORDS).op) == MAX_NODES - 1
    assert str(parse(near("RED").ljust(MAX_LENGTH), WORDS)) == near("RED")


def test_a_program_whose_canonical_form_is_too_long_is_rejected() -> None:
    word = "W" * 30
    text = "NEAR(HAND,AND(" + ",".join([word] * 130) + "))"
    assert len(text) <= MAX_LENGTH
    error = rejection(text, Vocabulary.of(shape=(word,), color=("RED",)))
    assert error.code == "program.too_long" and error.span == Span(0, len(text))
    assert error.received == f"{len(text) + 130} in canonical form"


def test_a_program_has_the_relation_that_its_text_names() -> None:
    program = parse(" LEFT_OF( HAND,AND(RED,NOT(CUBE)) )", SEVERAL)
    assert str(program) == "LEFT_OF(HAND, AND(RED, NOT(CUBE)))" and program.relation == "LEFT_OF"
    assert program != parse("NEAR(HAND, AND(RED, NOT(CUBE)))", SEVERAL)
    assert program.words == ("RED", "CUBE")


@pytest.mark.parametrize(
    ("text", "code", "position", "shown"),
    [
        ("BELOW(HAND, RED)", "unknown_word", 0, KNOWN),
        ("ABOV(HAND, RED)", "unknown_word", 0, "did you mean ABOVE?"),
        ("above(HAND, RED)", "wrong_case", 0, "expected ABOVE, received 'above'"),
        ("RED(HAND, RED)", "syntax", 0, f"expected {KNOWN}"),
        ("ABOVE(HAND, NEAR)", "syntax", 12, "(NEAR is not a property)"),
        ("ABOVE(HAND, RED, BLUE)", "arity", 0, "expected 2 arguments for ABOVE, received 3"),
        (" ", "empty", 0, "such as NEAR(HAND, CUBE)"),
    ],
)
def test_a_wrong_relation_is_rejected_with_the_known_ones(text, code, position, shown) -> None:
    error = rejection(text, SEVERAL)
    assert (error.code, error.position) == (f"program.{code}", position)
    assert shown in str(error)


@pytest.mark.parametrize(
    ("program", "received", "position"),
    [
        (Program(Word("RED"), "ABOVE"), "'ABOVE'", 0),
        (parse("NEAR(HAND, AND(RED, CUBE))", WORDS), "'CUBE'", 20),
    ],
)
def test_a_program_of_another_vocabulary_does_not_compile(program, received, position) -> None:
    with pytest.raises(ProgramError) as caught:
        compile_program(program, Vocabulary.of(shape=("SPHERE",), color=("RED",)))
    assert (caught.value.code, caught.value.received) == ("program.unknown_word", received)
    assert caught.value.position == position


@pytest.mark.parametrize("word", ["red", "RED CUBE", "AND", "RED"])
def test_a_vocabulary_rejects_words_that_no_text_can_name(word: str) -> None:
    with pytest.raises(ConfigError, match="vocabulary"):
        Vocabulary.of(shape=("CUBE",), color=("RED", word))


@pytest.mark.parametrize(
    ("relations", "why"),
    [
        ((), "expected 1 to 16 relations"),
        (("NEAR", "NEAR"), "'NEAR' is reserved or named twice"),
        (("RED",), "'RED' is reserved or named twice"),
        (("above",), "upper-case ASCII word, got 'above'"),
    ],
)
def test_a_vocabulary_rejects_relations_that_no_text_can_name(relations: tuple[str, ...], why: str):
    with pytest.raises(ConfigError, match=why):
        WORDS.asking(*relations)
    for other in (MOVING, WORDS.asking("ABOVE")):
        with pytest.raises(ConfigError, match="avoids: expected the relation NEAR of the hand"):
            other.avoiding()


@pytest.mark.parametrize(
    ("text", "code", "position", "message"),
    [
        ("NEAR(HAND, HAND)", "itself", 11, "expected another object than the hand"),
        ("NEAR(, RED)", "syntax", 5, "expected HAND, CUBE, SPHERE"),
        ("NEAR(RED, )", "syntax", 10, "expected HAND, CUBE, SPHERE"),
        ("NEAR(AND(RED, HAND), BLUE)", "syntax", 14, "HAND is not a property"),
        ("NEAR(RED)", "arity", 0, "2 arguments for NEAR, received 1"),
        ("NEAR(REDD, BLUE)", "unknown_word", 5, "did you mean RED?"),
    ],
)
def test_either_argument_may_be_any_set_where_objects_can_be_moved(text, code, position, message):
    error = rejection(text, MOVING)
    assert (error.code, error.position) == (f"program.{code}", position)
    assert message in error.message


def test_only_the_hand_comes_first_where_nothing_can_be_moved() -> None:
    program = parse("NEAR(AND(RED, CUBE), HAND)", MOVING)
    assert (str(program), program.words) == ("NEAR(AND(RED, CUBE), HAND)", ("RED", "CUBE"))
    assert "expected HAND" in rejection(str(program)).message
