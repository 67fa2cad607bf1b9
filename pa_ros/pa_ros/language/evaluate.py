"""The meaning of a program: crisp truth over true properties, soft truth over a matrix Φ.

These are the readable definitions, one object at a time. Batches of different programs run in
`pa_ros.world.programs`, which agrees with `relevance` to float precision.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import mul
from typing import Any

from pa_ros.core.errors import ConfigError
from pa_ros.language.errors import ProgramError, cannot_avoid, check_words, one_of
from pa_ros.language.syntax import HAND, ON, And, Expression, Not, Or, Program, Span, Word, left_out


@dataclass(frozen=True)
class Logic:
    """AND and OR of degrees in [0, 1], as numbers or arrays; NOT is 1 - x in every logic.

    On 0 and 1 all logics agree. Detectors multiply their logits by `sharpness`, the inverse of a
    softmax's temperature. This makes known properties nearly certain, and leaves a property that
    was never seen, for which no logit stands out, uncertain.
    """

    name: str
    both: Callable[[Any, Any], Any]
    either: Callable[[Any, Any], Any]
    sharpness: float = 1.0


def _sum(x: Any, y: Any) -> Any:
    return x + y - x * y


def _least(x: Any, y: Any) -> Any:
    return x * (x <= y) + y * (x > y)


def _most(x: Any, y: Any) -> Any:
    return x * (x >= y) + y * (x < y)


PRODUCT = Logic("product", mul, _sum)
"""xy and x + y - xy (paper, eq. logic). Learning uses it because every operand gets a gradient.
AND(e, e) squares e, however, so programs of equal meaning may have different degrees."""

MIN_MAX = Logic("min_max", _least, _most, sharpness=2.5)
"""The smaller and the greater (Zadeh 1965). Acting uses it because programs of equal meaning have
equal degrees: the laws of a distributive lattice hold exactly, and De Morgan's laws and double
negation hold up to rounding. The law of the excluded middle does not hold."""

LOGICS = {logic.name: logic for logic in (PRODUCT, MIN_MAX)}


def logic_named(name: str) -> Logic:
    """Look up a logic; ConfigError names the known ones."""
    if name not in LOGICS:
        raise ConfigError(f"logic: expected one of {tuple(LOGICS)}, got {name!r}")
    return LOGICS[name]


def roles(
    program: Program,
    objects: Sequence[Collection[str]],
    hand_index: int | None,
    bodiless: Collection[str] = (),
) -> tuple[tuple[bool, ...], tuple[bool, ...]]:
    """Whether the program's first and its second set contain each object, given the true words.

    This is what programs mean: the relation must hold between some object of the first set and
    another one of the second. Only HAND contains the hand, and NOT(RED) does not; `hand_index` is
    None if the hand is not among `objects`. Objects with a word of `bodiless` cannot be moved, so
    no first set contains them, nor held, so no second set of HOLD does. Nothing rests on what is
    ROUND, so no second set of ON contains it.
    """

    def contains(expression: Expression, i: int) -> bool:
        if i == hand_index or expression == HAND:
            return i == hand_index and expression == HAND
        return describes(expression, objects[i])

    def named(expression: Expression, left_out: Collection[str]) -> tuple[bool, ...]:
        may = (i == hand_index or set(left_out).isdisjoint(w) for i, w in enumerate(objects))
        return tuple(m and contains(expression, i) for i, m in enumerate(may))

    return named(program.moved, bodiless), named(program.target, left_out(program, bodiless))


def satisfying(
    program: Program,
    objects: Sequence[Collection[str]],
    hand_index: int | None,
    bodiless: Collection[str] = (),
) -> tuple[bool, ...]:
    """Whether one of the program's sets contains each object; False for the hand. See `roles`."""
    moved, target = roles(program, objects, hand_index, bodiless)
    either = (m or t for m, t in zip(moved, target, strict=True))
    return tuple(named and i != hand_index for i, named in enumerate(either))


def require_target(
    program: Program,
    objects: Sequence[Collection[str]],
    hand_index: int | None,
    bodiless: Collection[str] = (),
) -> None:
    """Raise ProgramError unless the relation can hold.

    `program.names_nothing` if a set contains no object, `program.needs_body` if all objects to move
    are bodiless, `program.needs_support` if nothing rests on any target, `program.itself` if the
    only target is the only object to move.
    """
    with_body = roles(program, objects, hand_index, bodiless)
    for argument, (one, named) in enumerate(zip(program.sets, with_body, strict=True)):
        if one == HAND or any(named):
            continue
        if any(i != hand_index and describes(one, words) for i, words in enumerate(objects)):
            rests = argument == 1 and program.relation == ON
            code, what = ("support", "on which others rest") if rests else ("body", "with a body")
            raise _rejected(program, f"program.needs_{code}", f"an object {what}", argument)
        expected = present_objects(objects, hand_index)
        raise _rejected(program, "program.names_nothing", expected, argument)
    objects_named = sum(satisfying(program, objects, hand_index, bodiless))
    if HAND not in program.sets and objects_named == 1:
        raise _rejected(program, "program.itself", "another object than the one to move", 1)


def present_objects(objects: Sequence[Collection[str]], hand_index: int | None) -> str:
    """For an "expected": the objects of a scene."""
    named = enumerate(w if isinstance(w, Sequence) else sorted(w) for w in objects)
    present = [" ".join(words) for i, words in named if i != hand_index]
    return f"an object of the scene ({one_of(present) if present else 'it is empty'})"


def _rejected(program: Program, code: str, expected: str, argument: int) -> ProgramError:
    """An error with a caret under the set of an argument (0 or 1) of the canonical text."""
    source, wrong = str(program), program.sets[argument]
    before = f"{program.arguments[0]}, " if argument else ""
    comparison = program.chosen[argument]
    start = len(f"{program.relation}({before}") + (len(f"{comparison}(") if comparison else 0)
    span = Span(start, start + len(str(wrong)))
    return ProgramError(source, span, code=code, expected=expected, received=f"{wrong}")


def describes(expression: Expression, words: Collection[str]) -> bool:
    """Crisp truth of an expression for one object, given its true words."""
    match expression:
        case Word(name):
            return name in words
        case Not(operand):
            return not describes(operand, words)
        case And(operands):
            return all(describes(operand, words) for operand in operands)
        case Or(operands):
            return any(describes(operand, words) for operand in operands)


def relevance(
    program: Program,
    phi: Sequence[Sequence[float]],
    row: Mapping[str, int],
    hand_index: int,
    logic: Logic = PRODUCT,
    bodiless: Collection[str] = (),
) -> list[float]:
    """Relevant objects p = OR(HAND, e) over soft sets (paper, eq. logic), one object at a time; if
    both arguments name objects, e is OR(p1, p2) of `role_relevance`.

    `phi` is [V][N], a row for each word and a column for each object, elements in [0, 1]; `row`
    gives the row of each word. Returns p, [N]; p of the hand is 1.
    Raises ProgramError (program.unknown_word) if a word of the program has no row.
    """
    degrees = role_relevance(program, phi, row, hand_index, logic, bodiless)
    named = [p for one, p in zip(program.sets, degrees, strict=True) if one != HAND]
    p = [reduce(logic.either, of_object) for of_object in zip(*named, strict=True)]
    if p:
        p[hand_index] = 1.0
    return p


def role_relevance(
    program: Program,
    phi: Sequence[Sequence[float]],
    row: Mapping[str, int],
    hand_index: int,
    logic: Logic = PRODUCT,
    bodiless: Collection[str] = (),
) -> tuple[list[float], list[float]]:
    """p1 and p2, [N] each: the degree to which each object is to be moved, and is a target.

    Only HAND contains the hand. Otherwise as `relevance`. Raises ProgramError if the program avoids
    a set, of which there is no degree here.
    """
    if program.avoided is not None:
        raise cannot_avoid(program)
    check_words(program, row)

    def of(expression: Expression, j: int) -> float:
        if j == hand_index or expression == HAND:
            return float(j == hand_index and expression == HAND)
        value: float = degree(expression, lambda word: phi[row[word]][j], logic)
        return value

    def of_set(expression: Expression, without: Collection[str]) -> list[float]:
        degrees = [of(expression, j) for j in range(len(phi[0]) if phi else 0)]
        if expression == HAND or not (known := [Word(word) for word in without if word in row]):
            return degrees
        out = Or(tuple(known))
        return [logic.both(p, 1.0 - of(out, j)) for j, p in enumerate(degrees)]

    return of_set(program.moved, bodiless), of_set(program.target, left_out(program, bodiless))


def degree(expression: Expression, value: Callable[[str], Any], logic: Logic = PRODUCT) -> Any:
    """Soft truth of an expression (paper, eq. logic); `value` gives that of a word, as a number or
    an array.

    AND and OR of more than two operands fold from the left.
    """
    match expression:
        case Word(name):
            return value(name)
        case Not(operand):
            return 1.0 - degree(operand, value, logic)
        case And(operands):
            return reduce(logic.both, (degree(operand, value, logic) for operand in operands))
        case Or(operands):
            return reduce(logic.either, (degree(operand, value, logic) for operand in operands))
