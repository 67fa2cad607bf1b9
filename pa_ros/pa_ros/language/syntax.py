"""The tree of a program. Nodes are frozen and hashable."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

NEAR = "NEAR"
"""The paper's relation."""
HOLD, ON = "HOLD", "ON"  # of the hand alone; of objects alone
ROUND = ("SPHERE",)
"""Words of objects on which nothing rests."""

OF_PLACES = ("LEFTMOST", "RIGHTMOST", "NEAREST", "FARTHEST")
OF_SIZES = ("LARGEST", "SMALLEST")
COMPARISONS = (*OF_PLACES, *OF_SIZES)
"""Each chooses one object of a set, by its place or by its size (`pa_ros.world.comparisons`)."""
SIZE = "size"
"""The group of properties whose number `OF_SIZES` compare. Only with it are they known."""


class Span(NamedTuple):
    """Characters `start` (included) to `end` (excluded) of a text, both 0-based."""

    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Word:
    """The objects that have a property of the vocabulary: RED."""

    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Not:
    """The objects that `operand` does not describe: NOT(RED)."""

    operand: Expression

    def __str__(self) -> str:
        return f"NOT({self.operand})"


@dataclass(frozen=True, slots=True)
class And:
    """The objects that every operand describes: AND(RED, CUBE). Two operands or more."""

    operands: tuple[Expression, ...]

    def __str__(self) -> str:
        return f"AND({', '.join(map(str, self.operands))})"


@dataclass(frozen=True, slots=True)
class Or:
    """The objects that at least one operand describes: OR(RED, CUBE). Two operands or more."""

    operands: tuple[Expression, ...]

    def __str__(self) -> str:
        return f"OR({', '.join(map(str, self.operands))})"


Expression: TypeAlias = Word | Not | And | Or

HAND = Word("HAND")
"""The set that contains the hand alone. It is a whole argument of a relation, never an operand."""


@dataclass(frozen=True, slots=True)
class Program:
    """A goal: an object that `moved` describes is in a relation, such as NEAR, to another one that
    `target` describes; until then the hand is never NEAR an object that `avoided` describes.

    In the paper the relation is NEAR, the hand is moved, and nothing is avoided (eq.
    program-example); `pa_ros.world.relation` contains all relations. `str()` gives the canonical
    text, which parses to an equal program.
    """

    target: Expression
    relation: str = NEAR
    moved: Expression = HAND
    avoided: Expression | None = None
    chosen: tuple[str, str] = ("", "")
    """Comparisons that choose one object of `moved` and of `target`; empty: any object will do."""

    def __str__(self) -> str:
        text = f"{self.relation}({', '.join(self.arguments)})"
        return text if self.avoided is None else f"AVOID({self.avoided}, {text})"

    @property
    def arguments(self) -> tuple[str, str]:
        """Canonical texts of both arguments."""
        first, second = (
            f"{comparison}({one})" if comparison else str(one)
            for comparison, one in zip(self.chosen, self.sets, strict=True)
        )
        return first, second

    @property
    def sets(self) -> tuple[Expression, Expression]:
        """What is to be in the relation, and what it is to be related to."""
        return self.moved, self.target

    @property
    def nouns(self) -> tuple[Expression, ...]:
        """The sets that objects are named by: those other than HAND."""
        return tuple(one for one in self.sets if one != HAND)

    @property
    def compares(self) -> bool:
        """Whether a comparison chooses among the objects of a set."""
        return any(self.chosen)

    @property
    def sets_alone(self) -> Program:
        """The same program without comparisons."""
        return replace(self, chosen=("", "")) if self.compares else self

    @property
    def relation_alone(self) -> Program:
        """The same program without a set to avoid."""
        return self if self.avoided is None else replace(self, avoided=None)

    @property
    def moves_hand(self) -> bool:
        """Whether the hand itself is to be in the relation."""
        return self.moved == HAND

    @property
    def words(self) -> tuple[str, ...]:
        """Property words that the program names, each once, in order of appearance."""
        sets = (*self.nouns, *([] if self.avoided is None else [self.avoided]))
        nodes = (node for one in sets for node in walk(one))
        names = (node.name for node in nodes if isinstance(node, Word))
        return tuple(dict.fromkeys(names))


def left_out(program: Program, bodiless: Collection[str]) -> Collection[str]:
    """Words of objects that the second set of a program leaves out."""
    return {HOLD: bodiless, ON: ROUND}.get(program.relation, ())


def walk(expression: Expression) -> Iterator[Expression]:
    """Yield an expression and all its parts, from left to right, outer before inner."""
    pending = [expression]
    while pending:
        node = pending.pop()
        yield node
        if isinstance(node, Not):
            pending.append(node.operand)
        elif isinstance(node, And | Or):
            pending.extend(reversed(node.operands))
