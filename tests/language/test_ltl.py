"""Formulas of temporal logic become goals that imply them; what no goal can say is refused."""

import random
import re

import pytest

from pa_ros.language import ProgramError, Progress, Vocabulary, parse_goal
from pa_ros.language.goals import Goal
from pa_ros.language.ltl import goal_from_ltl, holds, parse_ltl
from pa_ros.language.syntax import Program

WORDS = ("RED", "GREEN", "BLUE", "PINK")
VOCABULARY = Vocabulary.of(color=WORDS)

# Of the first ones a goal holds exactly where the formula does.
EXACT = (
    "F RED",
    "F F (RED | GREEN)",
    "!GREEN U RED",
    "!(GREEN | PINK) U (BLUE & F RED)",
    "F (RED & F (GREEN & F BLUE)) & F PINK",
    "F RED & (!RED U (GREEN & F BLUE))",
    "!GREEN U ((RED | PINK) & (!GREEN U BLUE))",
    "F (GREEN & F BLUE) & G !(RED | PINK)",
    "!F PINK & F RED",
)
STRONGER = (
    "F (GREEN & (!RED U BLUE)) & F PINK",
    "((GREEN | RED) => (!BLUE U PINK)) U BLUE",
    "F (BLUE & (!GREEN U (RED & F (GREEN & (!(PINK | RED) U BLUE)))))",
    "F (!GREEN U BLUE)",
    "(!RED & !GREEN) U (BLUE & (F RED & F GREEN))",
)


def first_state(goal: Goal, trace: list[frozenset[str]]) -> int | None:
    """The first state in which a goal's automaton holds."""
    progress = Progress.of(goal)
    for number, state in enumerate(trace):

        def near(program: Program, state: frozenset[str] = state) -> bool:
            return not state.isdisjoint(program.words)

        progress = progress.after(near)
        if progress.holds:
            return number
    return None


@pytest.mark.parametrize("text", EXACT + STRONGER)
def test_a_formula_holds_on_random_traces_where_its_goal_does(text: str) -> None:
    formula, goal = parse_ltl(text, VOCABULARY), goal_from_ltl(text, VOCABULARY)
    rng, held = random.Random(text), 0
    for _ in range(400):
        most = rng.choice((1, 2))  # the hand may be near two things at once
        states = range(rng.randint(1, 20))
        trace = [frozenset(rng.sample(WORDS, rng.randint(0, most))) for _ in states]
        at = first_state(goal, trace)
        prefixes = [holds(formula, trace[: n + 1]) for n in range(len(trace))]
        held += at is not None
        assert at is None or prefixes[at], (goal, trace)
        if text in EXACT and most == 1:
            assert at == (prefixes.index(True) if True in prefixes else None), (goal, trace)
    assert held > 3  # so that the test says something


def test_a_finite_trace_decides_every_operator() -> None:
    trace = [frozenset[str](), frozenset({"RED"}), frozenset({"GREEN"})]
    for text, expected in {
        "X RED": True, "RED": False, "G !BLUE": True, "G !RED": False, "!RED U GREEN": False,
        "(RED | !RED) U GREEN": True, "!BLUE W PINK": True, "RED R !PINK": True, "!X GREEN": True,
        "GREEN R !RED": False, "F (RED & X GREEN)": True, "X X X RED": False, "RED => BLUE": True,
        "GF GREEN": True, "F G RED": False,
    }.items():  # fmt: skip
        assert holds(parse_ltl(text, VOCABULARY), trace) is expected, text
    assert not holds(parse_ltl("G !RED", VOCABULARY), [])


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        ("F YELLOW", "program.unknown_word", "received 'YELLOW'"),
        ("F red", "program.wrong_case", "expected RED"),
        ("G RED", "program.syntax", "co-safe"),
        ("GF RED & GF BLUE", "program.syntax", "co-safe.*received G F RED"),
        ("RED", "program.syntax", "F before what is to be reached: F RED"),
        ("!RED & F BLUE", "program.syntax", "what to avoid before U, or under G"),
        ("X RED", "program.syntax", "X in X RED"),
        ("RED U BLUE", "program.syntax", "before U what is to be avoided"),
        ("F RED | F BLUE", "program.syntax", "no choice but of words"),
        ("F (RED & BLUE)", "program.syntax", "one thing at a time"),
        ("F (RED", "program.syntax", "received the end"),
        ("F RED $", "program.syntax", r"received '\$'"),
        ("", "program.syntax", "a formula of words"),
        ("!" * 296 + "RED", "program.syntax", "F before"),
        ("F RED & " * 40 + "F RED", "program.too_long", "at most 300"),
    ],
)
def test_what_no_goal_can_say_is_refused_with_the_reason(text: str, code: str, said: str) -> None:
    with pytest.raises(ProgramError) as caught:
        goal_from_ltl(text, VOCABULARY)
    assert caught.value.code == code and re.search(said, caught.value.message)


def test_what_must_be_avoided_first_is_pursued_first() -> None:
    goal = goal_from_ltl("F RED & (!RED U GREEN)", VOCABULARY)
    assert goal == parse_goal("ALL(AVOID(RED, NEAR(HAND, GREEN)), NEAR(HAND, RED))", VOCABULARY)
