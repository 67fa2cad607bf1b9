"""Linear temporal logic: formulas over words, as goals over time and on finite traces.

A word in a formula holds while the hand is NEAR an object that it describes:

    !GREEN U (BLUE & F RED)   becomes   THEN(AVOID(GREEN, NEAR(HAND, BLUE)), NEAR(HAND, RED))

Goals are co-safe: a run ends when the goal holds. So `G !RED` is taken beside something to reach
only, and means "until that is reached". Every goal implies its formula. It may ask for more: THEN
commits to the first state in which a part holds, and what is reached must itself not be avoided.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import pyparsing as pp

from pa_ros.language.errors import ProgramError, unknown_word
from pa_ros.language.goals import All, Avoid, Goal, Then, stages
from pa_ros.language.parser import parse_goal
from pa_ros.language.syntax import Expression, Or, Program, Span, Word
from pa_ros.language.vocabulary import Vocabulary

OPERATORS = frozenset("FGXUWR")
LONGEST = 300  # characters of a formula, so that its tree is not too deep


@dataclass(frozen=True)
class Formula:
    """An operator of OPERATORS, "!", "&", "|" or "=>" with its parts; or a word, which has none."""

    op: str
    parts: tuple[Formula, ...] = ()

    def __str__(self) -> str:
        if not self.parts:
            return self.op
        if len(self.parts) == 1:
            return f"{self.op}{' ' * self.op.isalpha()}{self._within(self.parts[0])}"
        return f" {self.op} ".join(map(self._within, self.parts))

    @staticmethod
    def _within(part: Formula) -> str:
        return f"({part})" if len(part.parts) > 1 else str(part)


def parse_ltl(text: str, vocabulary: Vocabulary) -> Formula:
    """Read a formula of ! & | => F G U (also X, W, R, which goals refuse) over a vocabulary's
    words; GF is G F. ProgramError for another text."""
    if len(text) > LONGEST:
        raise _error(text, f"at most {LONGEST} characters", str(len(text)), "program.too_long")
    try:
        formula: Formula = _grammar().parse_string(text, parse_all=True)[0]
    except pp.ParseBaseException as error:
        at = Span(error.loc, len(text))
        expected = "a formula of words and ! & | => F G U ( )"
        received = repr(text[error.loc : error.loc + 10]) if error.loc < len(text) else "the end"
        raise ProgramError(
            text, at, code="program.syntax", expected=expected, received=received
        ) from None
    for word in _words(formula):
        if word not in vocabulary.row:
            start = text.index(word)
            span = Span(start, start + len(word))
            raise unknown_word(text, span, word, vocabulary.words)
    return formula


def goal_from_ltl(text: str, vocabulary: Vocabulary) -> Goal:
    """The goal that implies a co-safe formula; ProgramError, with the reason, if no goal of THEN,
    ALL and AVOID does."""
    goal = _goal(_normal(parse_ltl(text, vocabulary)), text)
    return parse_goal(str(goal), vocabulary)  # its limits, and its canonical form


def holds(formula: Formula, trace: Sequence[frozenset[str]]) -> bool:
    """Whether a formula holds at the beginning of a finite trace, of which each state contains the
    words that hold there. Always is until the trace ends (De Giacomo and Vardi 2013)."""
    return _truth(formula, trace)[0] if trace else False


def _truth(formula: Formula, trace: Sequence[frozenset[str]]) -> list[bool]:
    """In which states of a trace a formula holds."""
    parts = [_truth(part, trace) for part in formula.parts]
    match formula.op, parts:
        case "!", (x,):
            return [not now for now in x]
        case "&", _:
            return [all(now) for now in zip(*parts, strict=True)]
        case "|", _:
            return [any(now) for now in zip(*parts, strict=True)]
        case "=>", (x, y):
            return [b or not a for a, b in zip(x, y, strict=True)]
        case "F", (x,):
            return _backwards(lambda now, later: now or later, False, x)
        case "G", (x,):
            return _backwards(lambda now, later: now and later, True, x)
        case "X", (x,):
            return [*x[1:], False]
        case ("U" | "W") as op, (x, y):
            both = zip(x, y, strict=True)
            return _backwards(lambda now, later: now[1] or (now[0] and later), op == "W", [*both])
        case "R", (x, y):
            both = zip(x, y, strict=True)
            return _backwards(lambda now, later: now[1] and (now[0] or later), True, [*both])
        case _:
            return [formula.op in state for state in trace]


def _backwards(step: Any, last: bool, values: Sequence[Any]) -> list[bool]:
    found = []
    for value in reversed(values):
        last = step(value, last)
        found.append(last)
    return found[::-1]


@cache
def _grammar() -> pp.ParserElement:
    pp.ParserElement.enable_packrat()
    operator = pp.one_of(" ".join(sorted(OPERATORS)), as_keyword=True)
    word = ~operator + ~pp.Keyword("GF") + pp.Regex(r"[A-Za-z_]\w*")
    word.set_parse_action(lambda found: Formula(found[0]))

    def unary(found: Any) -> Formula:
        formula: Formula
        *operators, formula = found[0]
        for one in reversed("".join(operators)):
            formula = Formula(one, (formula,))
        return formula

    def binary(found: Any) -> Formula:
        last: Formula
        *parts, last = found[0][::2]
        if (op := found[0][1]) in "&|":
            return Formula(op, (*parts, last))
        for part in reversed(parts):
            last = Formula(op, (part, last))
        return last

    before = pp.Literal("!") | pp.one_of("GF F G X", as_keyword=True)
    between = pp.one_of("U W R", as_keyword=True)
    levels = [
        (before, 1, pp.OpAssoc.RIGHT, unary),
        (between, 2, pp.OpAssoc.RIGHT, binary),
        *((sign, 2, pp.OpAssoc.LEFT, binary) for sign in "&|"),
        ("=>", 2, pp.OpAssoc.RIGHT, binary),
    ]
    grammar: pp.ParserElement = pp.infix_notation(word, levels)  # type: ignore[no-untyped-call]
    return grammar


def _words(formula: Formula) -> list[str]:
    if not formula.parts:
        return [formula.op]
    return [word for part in formula.parts for word in _words(part)]


def _normal(formula: Formula, negated: bool = False) -> Formula:
    """The same without =>, and with ! before words and "|" of words alone where that can be."""
    op, parts = formula.op, formula.parts
    if not parts:
        return Formula("!", (formula,)) if negated else formula
    if op == "!":
        return _normal(parts[0], not negated)
    if op == "=>":
        return _normal(Formula("|", (Formula("!", parts[:1]), parts[1])), negated)
    dual = {"&": "|", "|": "&", "F": "G", "G": "F", "X": "X", "U": "R", "R": "U"}
    if negated and op not in dual:
        return Formula("!", (formula,))
    inner = tuple(_normal(part, negated) for part in parts)
    return Formula(dual[op] if negated else op, inner)


def _goal(formula: Formula, text: str) -> Goal:
    """The goal of a formula in normal form that begins now."""
    op, parts = formula.op, formula.parts
    if op == "&":
        avoided = [kept for part in parts if (kept := _kept(part)) is not None]
        goals = [_goal(part, text) for part in parts if _kept(part) is None]
        if not goals:
            raise _unsafe(formula, text)
        # What must be avoided for a while comes before what may reach it.
        goals.sort(key=lambda one: stages(one)[0].avoided is None)
        goal = goals[0] if len(goals) == 1 else All(tuple(goals))
        return _avoiding(avoided, goal)
    if op == "F":
        return _reached(parts[0], [], text)
    if op == "U":
        free = _free(parts[0])
        if free is None:
            raise _error(text, "before U what is to be avoided, such as !RED", str(parts[0]))
        return _reached(parts[1], [free], text)
    if op == "|":
        raise _error(text, "one of the two: goals have no choice but of words", str(formula))
    if op in "XWR":
        raise _error(text, "! & | => F G U alone", f"{op} in {formula}")
    if op == "G":
        raise _unsafe(formula, text)
    if op == "!":
        raise _error(text, "what to avoid before U, or under G", str(formula))
    raise _error(text, f"F before what is to be reached: F {formula}", f"{formula}, now")


def _reached(formula: Formula, avoided: list[Expression], text: str) -> Goal:
    """The goal of coming to a state in which a formula holds, while a set is avoided."""
    parts = formula.parts if formula.op == "&" else (formula,)
    sets = [one for part in parts if (one := _set(part)) is not None]
    after = tuple(part for part in parts if _set(part) is None)
    if len(sets) > 1:
        raise _error(text, "the hand at one thing at a time", " & ".join(map(str, sets)))
    if not sets:  # what begins at any state may begin now
        return _avoiding(avoided, _goal(formula, text))
    reached = _avoiding(avoided, Program(sets[0]))
    if not after:
        return reached
    return Then((reached, _goal(Formula("&", after) if len(after) > 1 else after[0], text)))


def _avoiding(sets: Sequence[Expression], goal: Goal) -> Goal:
    return _avoiding(sets[1:], Avoid(sets[0], goal)) if sets else goal


def _set(formula: Formula) -> Expression | None:
    """The set of objects near which a formula of words alone holds; None for other formulas."""
    if not formula.parts:
        return Word(formula.op)
    if formula.op == "|" and all(sets := [_set(part) for part in formula.parts]):
        return Or(tuple(one for one in sets if one is not None))
    return None


def _free(formula: Formula) -> Expression | None:
    """The set near which a formula before U does not hold; of several choices the first one."""
    if formula.op == "!":
        return _set(formula.parts[0])
    if formula.op == "&" and all(sets := [_free(part) for part in formula.parts]):
        return Or(tuple(one for one in sets if one is not None))
    if formula.op == "|":
        return next((one for part in formula.parts if (one := _free(part)) is not None), None)
    return None


def _kept(formula: Formula) -> Expression | None:
    """The set that G ! keeps away from; None for other formulas."""
    return _free(formula.parts[0]) if formula.op == "G" else None


def _unsafe(formula: Formula, text: str) -> ProgramError:
    return _error(text, "a formula that is co-safe: a run ends, and G never does", str(formula))


def _error(text: str, expected: str, received: str, code: str = "program.syntax") -> ProgramError:
    return ProgramError(text, Span(0, len(text)), code=code, expected=expected, received=received)
