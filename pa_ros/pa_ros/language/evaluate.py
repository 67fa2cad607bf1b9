"""What a program means: crisp truth over true properties, soft truth over a matrix Φ.

These are the readable definitions, one object at a time. Batches of different programs run in
`pa_ros.world.programs`, which agrees with `relevance` to float precision.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import reduce
from operator import mul
from typing import Any

from pa_ros.core.errors import ConfigError
from pa_ros.language.errors import ProgramError, one_of, unknown_word
from pa_ros.language.syntax import And, Expression, Not, Or, Program, Span, Word


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


def satisfying(
    program: Program, objects: Sequence[Set[str]], hand_index: int | None
) -> tuple[bool, ...]:
    """Whether the program names each object, given the true words of each.

    The hand is never named, not even by NOT(RED); `hand_index` is None if the hand is not among
    `objects`.
    """
    return tuple(
        i != hand_index and describes(program.target, words) for i, words in enumerate(objects)
    )


def require_target(
    program: Program, objects: Sequence[Set[str]], hand_index: int | None
) -> tuple[bool, ...]:
    """Like `satisfying`, but raise ProgramError (program.names_nothing) if no object is named."""
    named = satisfying(program, objects, hand_index)
    if not any(named):
        present = [" ".join(sorted(w)) for i, w in enumerate(objects) if i != hand_index]
        source = str(program)
        raise ProgramError(
            source,
            Span(len(f"{program.relation}(HAND, "), len(source) - 1),
            code="program.names_nothing",
            expected=f"an object of the scene ({one_of(present) if present else 'it is empty'})",
            received=f"{program.target}",
        )
    return named


def describes(expression: Expression, words: Set[str]) -> bool:
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
) -> list[float]:
    """Relevant objects p = OR(HAND, e) over soft sets (paper, eq. logic), one object at a time.

    `phi` is [V][N], a row for each word and a column for each object, elements in [0, 1]; `row`
    gives the row of each word. Returns p, [N]; p of the hand is 1.
    Raises ProgramError (program.unknown_word) if a word of the program has no row.
    """
    check_words(program, row)
    columns = len(phi[0]) if phi else 0

    def of(j: int) -> float:
        value: float = degree(program.target, lambda word: phi[row[word]][j], logic)
        return value

    return [logic.either(1.0 if j == hand_index else 0.0, of(j)) for j in range(columns)]


def check_words(program: Program, known: Mapping[str, int]) -> None:
    """Raise ProgramError (program.unknown_word) if the program has a word outside `known`."""
    for word in program.words:
        if word not in known:
            raise foreign_word(program, word, known)


def foreign_word(program: Program, word: str, known: Mapping[str, int]) -> ProgramError:
    """An error for a program of another vocabulary, with a caret in its canonical text."""
    source = str(program)
    # The program may have been built without a text, so search its canonical text for the word.
    place = re.search(rf"\b{re.escape(word)}\b", source)
    return unknown_word(source, Span(*place.span()) if place else program.span, word, known)


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
