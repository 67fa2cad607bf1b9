"""What an agent receives: steps put together from their parts, programs known by their ids."""

from typing import Any

import pytest

from agent_node.inputs import INCOMPLETE_STEPS, PROGRAMS, ProgramBook, StepMatcher
from pa_ros.core.errors import PaError
from pa_ros.language import ProgramError, Vocabulary
from pa_ros.wire.program import ProgramRequest


@pytest.fixture
def matcher() -> Any:  # messages are texts here
    return StepMatcher(("a", "b"))


def test_messages_of_one_stamp_are_joined_in_order_of_time(matcher):
    assert matcher.add("a", 10, "a10") is None and matcher.add("b", 20, "b20") is None
    assert matcher.add("b", 10, "b10") == {"a": "a10", "b": "b10"}
    assert matcher.add("a", 20, "a20") == {"a": "a20", "b": "b20"}
    with pytest.raises(PaError, match="expected a stamp of at least 20 ns, got 10") as refused:
        matcher.add("a", 10, "late")
    assert refused.value.code == "observation.stale"
    assert matcher.add("a", 20, "again") is None  # the arena repeats a step without an answer
    matcher.restart()
    assert matcher.add("a", 1, "a") is None and matcher.add("b", 1, "b") is not None


def test_only_the_newest_incomplete_steps_are_kept(matcher):
    for stamp in range(2 * INCOMPLETE_STEPS):
        matcher.add("a", stamp, "a")
    assert matcher.add("b", 0, "b") is None
    assert matcher.add("b", 2 * INCOMPLETE_STEPS - 1, "b") is not None


def test_the_newest_incomplete_step_says_what_it_lacks(matcher):
    assert matcher.lacking == []
    matcher.add("a", 10, "a10")
    matcher.add("b", 20, "b20")
    assert matcher.lacking == ["a"]
    matcher.add("a", 20, "a20")
    assert matcher.lacking == []


@pytest.fixture
def book() -> ProgramBook:
    return ProgramBook(Vocabulary.of(color=("RED", "BLUE")))


def test_an_accepted_program_is_remembered_by_id_and_parsed_once(book):
    assert book.accept(ProgramRequest("1", "NEAR(HAND,RED )")) == "NEAR(HAND, RED)"
    assert book.accept(ProgramRequest("1", "NEAR(HAND, RED)")) == "NEAR(HAND, RED)"
    assert book.program("NEAR(HAND, RED)") is book.program("NEAR(HAND, RED)")
    assert book.named("1", "NEAR(HAND, RED)") is book.program("NEAR(HAND, RED)")
    assert book.named("1", "NEAR(HAND, BLUE)") is book.named("2", "NEAR(HAND, RED)") is None


def test_a_reused_id_and_an_invalid_text_are_rejected(book):
    book.accept(ProgramRequest("1", "NEAR(HAND, RED)"))
    with pytest.raises(PaError) as refused:
        book.accept(ProgramRequest("1", "NEAR(HAND, BLUE)"))
    assert refused.value.code == "program.id_taken"
    with pytest.raises(ProgramError):
        book.accept(ProgramRequest("2", "NEAR(HAND, PINK)"))
    for number in range(PROGRAMS):
        book.name(f"other {number}", "NEAR(HAND, RED)")
    assert book.accept(ProgramRequest("1", "NEAR(HAND, BLUE)"))  # the id is forgotten
