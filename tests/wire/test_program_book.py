"""The programs that an agent receives are known by their ids."""

import pytest

from pa_ros.core.errors import PaError
from pa_ros.language import ProgramError, Vocabulary
from pa_ros.wire.program import ProgramRequest
from pa_ros.wire.program_book import PROGRAMS, ProgramBook


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
