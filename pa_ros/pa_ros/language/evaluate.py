"""What a program means: crisply over true properties, softly over a matrix Φ.

These are the readable definitions, one object at a time. Batches of different programs run in
`pa_ros.world.programs`, which agrees with `relevance` to float precision.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence, Set
from functools import reduce
from typing import Any

from pa_ros.core.errors import ConfigError
from pa_ros.language.errors import NamesNothingError, ProgramError, one_of, refuse_word
from pa_ros.language.logic import PRODUCT, Logic
from pa_ros.language.span import Span
from pa_ros.language.syntax import And, Expression, Not, Or, Program, Word


def satisfying(
    program: Program, objects: Sequence[Set[str]], hand_index: int | None
) -> tuple[bool, ...]:
    """Say for each object whether the program names it, given each object's true words.

    A word that names nothing in the world is in no object's set. The hand is never a target, not
    even of NOT(RED); `hand_index` is None if the hand is not among `objects`.
    Raises ConfigError if the index is not one of the objects.
    """
    check_hand(hand_index, len(objects))
    return tuple(
        i != hand_index and describes(program.target, words) for i, words in enumerate(objects)
    )


def require_target(
    program: Program, objects: Sequence[Set[str]], hand_index: int | None
) -> tuple[bool, ...]:
    """Like `satisfying`, but raise NamesNothingError if the program names no object."""
    named = satisfying(program, objects, hand_index)
    if not any(named):
        present = [" ".join(sorted(w)) for i, w in enumerate(objects) if i != hand_index]
        source = str(program)
        raise NamesNothingError(
            source,
            Span(len(f"{program.relation}(HAND, "), len(source) - 1),
            expected=f"an object of the scene ({one_of(present) if present else 'it is empty'})",
            received=f"{program.target}",
        )
    return named


def describes(expression: Expression, words: Set[str]) -> bool:
    """Crisp truth of an expression for one object whose true words are given."""
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
    Raises UnknownWordError if the program names a word without a row.
    """
    for word in program.words:
        if word not in row:
            raise unknown_word(program, word, row)
    columns = len(phi[0]) if phi else 0
    check_hand(hand_index, columns)

    def of(j: int) -> float:
        value: float = degree(program.target, lambda word: phi[row[word]][j], logic)
        return value

    return [logic.either(1.0 if j == hand_index else 0.0, of(j)) for j in range(columns)]


def unknown_word(program: Program, word: str, known: Mapping[str, int]) -> ProgramError:
    """Error for a program of another vocabulary, pointing into its canonical text."""
    source = str(program)
    place = re.search(rf"\b{re.escape(word)}\b", source)
    span = Span(*place.span()) if place else program.span
    return refuse_word(source, span, word, known)


def degree(expression: Expression, value: Callable[[str], Any], logic: Logic = PRODUCT) -> Any:
    """Soft truth from each word's (paper, eq. logic): of numbers a number, of arrays an array.

    AND and OR of more than two fold from the left.
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


def check_hand(hand_index: int | None, objects: int) -> None:
    """Raise ConfigError unless `hand_index` is None or the index of one of so many objects."""
    if hand_index is not None and not 0 <= hand_index < objects:
        raise ConfigError(f"hand_index: expected one of {objects} objects, got {hand_index}")
