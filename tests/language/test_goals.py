"""Goals over time: text, errors, and the automaton against a reading of whole traces."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.rejections import rejected
from pa_ros.language import (
    All,
    Avoid,
    Expression,
    Goal,
    Program,
    ProgramError,
    Progress,
    Then,
    Vocabulary,
    Word,
    compile_program,
    parse,
    parse_goal,
    require_possible,
    stages,
)
from pa_ros.language.parser import MAX_GOAL_DEPTH

WORDS = Vocabulary.of(shape=("CUBE", "SPHERE"), color=("RED", "BLUE"))
MOVING = WORDS.moving()
SCENE = [frozenset[str](), {"CUBE", "RED"}, {"SPHERE", "BLUE"}, {"CUBE", "BLUE"}]

# Goals over three blocks, of which the programs move the hand or RED, and their traces: the
# programs that hold in each state.
REACHES = [Program(Word(word)) for word in ("RED", "BLUE", "CUBE")]
PUSHES = [Program(Word(word), moved=Word("RED")) for word in ("BLUE", "CUBE")]
ATOMS = [*REACHES, *PUSHES]


def _wider(inner: st.SearchStrategy[Goal]) -> st.SearchStrategy[Goal]:
    several = st.lists(inner, min_size=2, max_size=3).map(tuple)
    avoided = st.sampled_from([Word("RED"), Word("BLUE")])
    return st.one_of(several.map(Then), several.map(All), st.builds(_avoiding, avoided, inner))


def _avoiding(avoided: Word, goal: Goal) -> Goal:
    if isinstance(goal, Program) and goal.avoided is None:
        return Program(goal.target, moved=goal.moved, avoided=avoided)
    return Avoid(avoided, goal)


goals = st.recursive(st.sampled_from(ATOMS), _wider, max_leaves=5)
traces = st.lists(st.frozensets(st.sampled_from(ATOMS)), min_size=1, max_size=7)
Trace = list[frozenset[Program]]


def holds(goal: Goal, trace: Trace, s: int, t: int) -> bool:
    """Whether a goal that begins at state s holds in state t, by all states between."""

    def kept(avoided: Expression | None) -> bool:
        return avoided is None or all(Program(avoided) not in state for state in trace[s : t + 1])

    match goal:
        case Program():
            return goal.relation_alone in trace[t] and kept(goal.avoided)
        case Avoid(avoided, inner):
            return kept(avoided) and holds(inner, trace, s, t)
        case All(parts):
            return all(
                holds(part, trace, s, t)
                or (not moves(part) and any(holds(part, trace, s, u) for u in range(s, t)))
                for part in parts
            )
        case Then(parts):
            for part in parts[:-1]:
                ends = [u for u in range(s, t + 1) if holds(part, trace, s, u)]
                if not ends:
                    return False
                s = ends[0]
            return holds(parts[-1], trace, s, t)


def moves(goal: Goal) -> bool:
    """Whether the end of a goal is that an object was moved."""
    match goal:
        case Program():
            return not goal.moves_hand
        case Then(parts):
            return moves(parts[-1])
        case All(parts):
            return any(moves(part) for part in parts)
        case Avoid(_, inner):
            return moves(inner)


@given(goals, traces)
def test_the_automaton_agrees_with_the_reading_of_the_whole_trace(goal: Goal, trace: Trace) -> None:
    progress, pursued = Progress.of(goal), stages(goal)
    for t, state in enumerate(trace):
        progress = progress.after(state.__contains__)
        assert progress.holds == holds(goal, trace, 0, t)
        assert progress.stage < len(pursued)
        if not progress.holds and not progress.violated:
            assert pursued[progress.stage].relation_alone not in state
        if progress.violated:
            assert not progress.holds


@given(goals)
def test_the_text_of_a_goal_parses_to_an_equal_goal(goal: Goal) -> None:
    try:
        assert parse_goal(str(goal), MOVING) == goal
    except ProgramError as error:
        assert error.code == "program.too_deep"


def test_a_program_alone_is_what_it_was() -> None:
    text = "NEAR(HAND, AND(RED, CUBE))"
    assert parse_goal(text, WORDS) == parse(text, WORDS)
    assert stages(parse(text, WORDS)) == (parse(text, WORDS),)


def test_each_stage_avoids_all_that_is_avoided_around_it() -> None:
    goal = parse_goal("AVOID(RED, THEN(NEAR(HAND, CUBE), AVOID(BLUE, NEAR(HAND, SPHERE))))", WORDS)
    assert [str(one) for one in stages(goal)] == [
        "AVOID(RED, NEAR(HAND, CUBE))",
        "AVOID(OR(RED, BLUE), NEAR(HAND, SPHERE))",
    ]


def test_the_stage_of_a_goal_in_a_goal_is_counted_in_the_order_of_the_text() -> None:
    (a, b, c), (push, other), sphere = REACHES, PUSHES, Word("SPHERE")
    goal = Then((All((a, b)), Avoid(sphere, Then((b, All((push, other, c)))))))
    assert [one.relation_alone for one in stages(goal)] == [a, b, b, push, other, c]
    progress, reached = Progress.of(goal), []
    last = {push, other, Program(sphere)}
    for state in ({b}, {a}, set[Program](), {b, push}, {c}, {push, other}, {other}, last):
        progress = progress.after(state.__contains__)
        reached.append((progress.stage, progress.holds))
    before = [(0, False), (2, False), (2, False), (4, False), (3, False), (5, True), (3, False)]
    assert reached == [*before, (5, False)] and progress.violated


P = "NEAR(HAND, RED)"
DEEPEST = "THEN(" * MAX_GOAL_DEPTH + P + f", {P})" * MAX_GOAL_DEPTH
INVALID = {  # text: code, position, part of the message
    f"THEN({P})": ("program.arity", 0, "expected 2 arguments or more for THEN, received 1"),
    "ALL()": ("program.arity", 0, "expected 2 arguments or more for ALL, received 0"),
    f"THEN(RED, {P})": ("program.syntax", 5, "expected NEAR, THEN, ALL or AVOID, received 'RED'"),
    f"AVOID({P}, {P})": ("program.syntax", 6, "(NEAR is not a property)"),
    f"NEAR(HAND, THEN({P}, {P}))": ("program.syntax", 11, "(THEN is a goal, not a set)"),
    f"AVOID(RED, {P}, {P})": ("program.syntax", 26, "expected ')', received ','"),
    "AVOID(RED)": ("program.syntax", 9, "expected ',', received ')'"),
    f"AVOID(HAND, {P})": ("program.syntax", 6, "received 'HAND'"),
    f"THEN({P}, {P}": ("program.syntax", 37, "expected ',' or ')'"),
    f"ALL({DEEPEST}, {P})": ("program.too_deep", 19, "at most 4 of THEN, ALL and AVOID"),
    f"then({P}, {P})": ("program.wrong_case", 0, "did you mean THEN?"),
    f"THEN({P}, {P}) {P}": ("program.syntax", 39, "expected the end of the text"),
}


@pytest.mark.parametrize("text", INVALID)
def test_a_wrong_goal_is_rejected_at_its_fault(text: str) -> None:
    code, position, message = INVALID[text]
    with rejected(code) as caught:
        parse_goal(text, MOVING)
    assert message in str(caught.value)
    assert isinstance(caught.value, ProgramError) and caught.value.position == position


def test_goals_may_be_nested_to_the_limit() -> None:
    assert str(parse_goal(DEEPEST, WORDS)) == DEEPEST


def test_nothing_can_be_avoided_without_the_relation_near() -> None:
    with rejected("program.syntax", "expected ABOVE, THEN or ALL, received 'AVOID'"):
        parse_goal("AVOID(RED, ABOVE(HAND, BLUE))", WORDS.asking("ABOVE"))


def test_a_goal_over_time_is_no_single_program() -> None:
    with rejected("program.over_time", "received THEN\n") as caught:
        parse(f"THEN({P}, {P})", WORDS)
    assert isinstance(caught.value, ProgramError) and caught.value.span == (0, 38)
    assert parse(f"AVOID(BLUE, {P})", WORDS).avoided == Word("BLUE")


def test_phi_alone_has_no_meaning_for_a_program_that_avoids() -> None:
    with rejected("program.avoids"):
        compile_program(parse(f"AVOID(BLUE, {P})", WORDS), WORDS)


NOTHING = "program.names_nothing"
IMPOSSIBLE = {  # text: code, the part of it under the caret
    f"THEN({P}, NEAR(HAND, AND(RED, SPHERE)))": (NOTHING, "AND(RED, SPHERE)"),
    f"AVOID(AND(RED, SPHERE), {P})": (NOTHING, "AND(RED, SPHERE)"),
    f"THEN({P}, AVOID(CUBE, NEAR(HAND, RED)))": ("program.avoids_target", "CUBE"),
    f"AVOID(CUBE, THEN(NEAR(HAND, SPHERE), AVOID(BLUE, {P})))": ("program.avoids_target", "CUBE"),
    "AVOID(RED, NEAR(RED, SPHERE))": ("program.avoids_target", "RED"),
    f"ALL({P}, NEAR(SPHERE, SPHERE))": ("program.itself", "SPHERE"),
    "AVOID(RED, AVOID(SPHERE, NEAR(HAND, AND(BLUE, RED))))": (NOTHING, "AND(BLUE, RED)"),
    "AVOID(RED, AVOID(AND(RED, SPHERE), NEAR(HAND, BLUE)))": (NOTHING, "AND(RED, SPHERE)"),
}


@pytest.mark.parametrize("text", IMPOSSIBLE)
def test_a_goal_that_cannot_hold_in_a_scene_is_rejected_at_its_set(text: str) -> None:
    code, part = IMPOSSIBLE[text]
    with rejected(code) as caught:
        require_possible(parse_goal(text, MOVING), SCENE, 0)
    error = caught.value
    assert isinstance(error, ProgramError) and error.source == text
    assert text[slice(*error.span)] == part


def test_a_goal_that_avoids_some_of_its_targets_is_possible() -> None:
    require_possible(parse_goal("AVOID(RED, NEAR(HAND, CUBE))", WORDS), SCENE, 0)
    require_possible(
        parse_goal("AVOID(RED, ABOVE(HAND, RED))", WORDS.asking("NEAR", "ABOVE")), SCENE, 0
    )
