"""Any text is parsed, or rejected by a ProgramError within the text."""

import pytest
from hypothesis import strategies as st

from helpers.damage import explore
from pa_ros.arena import design_named
from pa_ros.language import ProgramError, parse_goal, stages
from pa_ros.language.parser import MAX_LENGTH
from pa_ros.world.programs import ProgramTable

PROGRAMS = 1_000_000
AT_ONCE = 20  # programs of one case
WORDS = design_named("2-L").vocabulary
KEPT = ("", "((((", "NEAR(HAND, \u202eRED)", "NEAR(HAND, \ud800)", "NEAR（HAND, RED)", "\0")

TOKENS = (
    *("NEAR", "NEAR(", "HAND", "HAND,", "AND(", "OR(", "NOT(", "(", ")", "))", ",", ",,", " "),
    *("THEN(", "ALL(", "AVOID(", "AVOID(RED,", "THEN(NEAR(HAND, RED),"),
    *("\t", "\n", "NEAR(HAND, RED)", "NOT(NOT(", "near", "É", "（", "\0", "\ud800", "\u202e", "1"),
    *WORDS.words,
)
texts = st.one_of(
    st.lists(st.sampled_from(TOKENS), max_size=24).map("".join),
    st.tuples(st.sampled_from(TOKENS), st.integers(1, MAX_LENGTH)).map(lambda t: t[0] * t[1]),
    st.text(max_size=40),
    st.text("NEARHDOTU(), ", max_size=40).map(lambda text: f"NEAR(HAND, {text})"),
)


def check(text: str) -> object:
    """A parsed goal prints to a text that parses to itself; its programs compile, unless they avoid
    something."""
    try:
        goal = parse_goal(text, WORDS)
    except ProgramError as error:
        assert error.code.startswith("program.") and -1 <= error.position <= len(text)
        assert str(error).isascii()
        return None
    assert parse_goal(str(goal), WORDS) == goal
    table = ProgramTable(WORDS)
    return [table.add(program.relation_alone) for program in stages(goal)]


@pytest.mark.parametrize("text", KEPT)
def test_cases_found_before(text: str):
    check(text)


@pytest.mark.timeout(0)
def test_programs():
    cases = st.lists(texts, min_size=AT_ONCE, max_size=AT_ONCE)
    explore(cases, lambda several: list(map(check, several)), PROGRAMS // AT_ONCE)
