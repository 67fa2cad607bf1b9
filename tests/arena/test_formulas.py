"""The finite formulas: each of our goals implies its formula, on every trace of some length."""

import random
import re
from collections.abc import Callable
from itertools import combinations
from math import hypot

import pytest

from pa_ros.arena import Kind, ReachTask, design_named, preset_named, scripted_action
from pa_ros.arena.formulas import FORMULAS, ZONES, ZONES_APART_M, goal_of
from pa_ros.language import Program, Progress, satisfying

DESIGN = design_named("3-D-avoid")
COLORS = ("BLUE", "GREEN", "RED", "RED")
SHAPES = ("CUBE", "CUBE", "CUBE", "SPHERE")
KINDS = {
    zone: Kind(color=color, shape=shape)
    for zone, color, shape in zip(ZONES, COLORS, SHAPES, strict=True)
}
Trace = list[frozenset[str]]  # the zones in which the hand is, state by state
Formula = Callable[[Trace], bool]


def ltl(text: str) -> Formula:
    """Whether a finite trace satisfies a formula, by the definitions of its operators."""
    tokens = re.findall(r"=>|[!&|()FU]|[a-z]", text)

    def primary() -> Formula:
        token = tokens.pop(0)
        if token == "(":
            inner = implication()
            assert tokens.pop(0) == ")"
            return inner
        if token in "!F":
            inner = primary()
            if token == "!":
                return lambda trace: not inner(trace)
            return lambda trace: any(inner(trace[i:]) for i in range(len(trace)))
        return lambda trace: bool(trace) and token in trace[0]

    def until() -> Formula:
        left = primary()
        if not tokens or tokens[0] != "U":
            return left
        tokens.pop(0)
        right = until()
        return lambda trace: any(
            right(trace[i:]) and all(left(trace[j:]) for j in range(i)) for i in range(len(trace))
        )

    def joined(
        sign: str, part: Callable[[], Formula], rule: Callable[[list[bool]], bool]
    ) -> Formula:
        parts = [part()]
        while tokens and tokens[0] == sign:
            tokens.pop(0)
            parts.append(part())
        return lambda trace: rule([one(trace) for one in parts])

    def disjunction() -> Formula:
        return joined("|", lambda: joined("&", until, all), any)

    def implication() -> Formula:
        left = disjunction()
        if not tokens or tokens[0] != "=>":
            return left
        tokens.pop(0)
        right = implication()
        return lambda trace: not left(trace) or right(trace)

    found = implication()
    assert not tokens
    return found


@pytest.mark.parametrize("condition", FORMULAS)
def test_a_goal_that_holds_implies_its_formula(condition: str) -> None:
    formula = ltl(FORMULAS[condition][0])
    goal, rng, held = goal_of(condition, KINDS, DESIGN.vocabulary), random.Random(0), 0
    for _ in range(3000):
        progress, trace = Progress.of(goal), Trace()
        for _ in range(10):  # the hand is in one zone at most, since they don't overlap
            inside = frozenset(rng.choice([*({zone} for zone in ZONES), set()]))
            trace.append(inside)

            def holds(program: Program, inside: frozenset[str] = inside) -> bool:
                words = [KINDS[zone].words for zone in inside]
                return any(satisfying(program, words, None))

            progress = progress.after(holds)
            if progress.holds:
                break
        if progress.holds:
            assert formula(trace), [*map(sorted, trace)]
            held += 1
    assert held > 20


def test_the_reading_of_formulas_tells_traces_apart() -> None:
    formula = ltl("!g U ((b|m) & (!g U y))")
    b, g, y, none = (frozenset(one) for one in ("b", "g", "y", ""))
    assert formula([none, b, none, y])
    assert not formula([none, b, g, y]) and not formula([g, b, y]) and not formula([b, none])
    assert ltl("((g|b) => (!y U m)) U y")([none, y])
    assert not ltl("((g|b) => (!y U m)) U y")([g, y])


@pytest.mark.parametrize("condition", FORMULAS)
def test_zones_do_not_overlap_and_the_script_can_reach_them(condition: str) -> None:
    task = ReachTask(preset_named("fast"), DESIGN, seed=5)
    task.reset(0, condition)
    blocks = task.episode.blocks
    assert len(blocks) == len(ZONES)
    for a, b in combinations(blocks, 2):
        assert hypot(a.x - b.x, a.y - b.y) >= ZONES_APART_M
    start = task.program
    for _ in range(40):
        _, verdict = task.step(scripted_action(task))
    assert verdict.violated or verdict.satisfied or task.program != start
