"""What a person reads when a program is refused."""

from __future__ import annotations

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.language import And, ProgramError, Vocabulary, Word, parse
from pa_ros.language.errors import SHOWN_WORDS, one_of
from pa_ros.language.span import EXCERPT_WIDTH, Span, excerpt

VOCABULARY = Vocabulary.of(shape=("CUBE", "SPHERE"), color=("RED", "BLUE"))


def refusal(text: str, vocabulary: Vocabulary = VOCABULARY) -> ProgramError:
    with pytest.raises(ProgramError) as caught:
        parse(text, vocabulary)
    return caught.value


def test_the_caret_stands_under_the_word() -> None:
    assert str(refusal("NEAR(HAND, AND(RED, CUBBE))")) == (
        "column 21: unknown word: expected CUBE, SPHERE, RED, BLUE, AND, OR or NOT, "
        "received 'CUBBE'; did you mean CUBE?\n"
        "  NEAR(HAND, AND(RED, CUBBE))\n"
        "                      ^~~~~"
    )


def test_attributes_say_what_the_message_says() -> None:
    error = refusal("NEAR(HAND, BLU)")
    assert error.span == Span(11, 14)
    assert error.position == 11
    assert error.received == "'BLU'"
    assert error.suggestion == "BLUE"
    assert error.message == str(error).split("\n")[0]


def test_a_blank_text_has_no_excerpt() -> None:
    assert "\n" not in str(refusal("   "))
    assert refusal("   ").message.endswith("received nothing")


def test_of_several_lines_only_the_right_one_is_shown() -> None:
    assert str(refusal("NEAR(HAND,\r\n\tAND(RED,\n     GREN))")).split("\n")[1:] == [
        "       GREN))",
        "       ^~~~",
    ]


def test_a_span_over_two_lines_is_underlined_to_the_end_of_the_first() -> None:
    assert str(refusal("NEAR(HAND, NOT(RED,\n BLUE))")).split("\n")[1:] == [
        "  NEAR(HAND, NOT(RED,",
        "             ^~~~~~~~",
    ]


def test_a_long_line_is_cut_to_a_window_around_the_caret() -> None:
    text = f"NEAR(HAND, AND({'RED, ' * 60}GREEEN, {'RED, ' * 60}RED))"
    shown, caret = str(refusal(text)).split("\n")[1:]
    assert shown.startswith("  ...") and shown.endswith("...")
    assert len(shown) == EXCERPT_WIDTH + 8
    start = caret.index("^")
    assert shown[start : start + len("GREEEN")] == "GREEEN"
    assert caret[start:] == "^~~~~~"


def test_an_excerpt_holds_nothing_a_terminal_would_obey() -> None:
    shown, caret = excerpt("\x1b[31m\tRED \u202e\uff08 X", Span(13, 14)).split("\n")
    assert shown == "  ?[31m RED ?? X"
    assert shown[caret.index("^")] == "X"


def test_a_caret_after_the_end_is_shown_where_something_is_missing() -> None:
    shown, caret = str(refusal("NEAR(HAND, RED  \n")).split("\n")[1:]
    assert caret.index("^") == shown.index("RED") + 3


def test_long_lists_and_words_are_cut() -> None:
    many = Vocabulary.of(shape=("CUBE",), color=tuple(f"COLOR{i}" for i in range(200)))
    message = refusal(f"NEAR(HAND, {'X' * 300})", many).message
    assert "or 188 more, received 'XXXX" in message
    assert len(message) < 300
    assert one_of(["A"] * SHOWN_WORDS).count("A") == SHOWN_WORDS


def test_an_operator_without_operands_cannot_be_built() -> None:
    with pytest.raises(ConfigError, match=r"AND: expected a tuple of two or more operands, got \("):
        And((Word("RED"),))


@pytest.mark.parametrize("word", ["red", "Red", "RED CUBE", "", "1RED", "RÉD", "AND", "RED"])
def test_words_that_no_vocabulary_has_are_refused(word: str) -> None:
    with pytest.raises(ConfigError, match="vocabulary"):
        Vocabulary.of(shape=("CUBE",), color=("RED", word))
