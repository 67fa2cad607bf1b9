"""Random programs of a given depth, in which every operator matters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pa_ros.arena.designs import Design, Kind
from pa_ros.arena.errors import ArenaError
from pa_ros.language import And, Expression, Not, Or, Program, Word, satisfying

TRIES = 10_000  # draws of a program before it is given up

Denotation = tuple[bool, ...]
"""Whether an expression describes each kind of a pool."""


class DeepPrograms:
    """Draws random programs that are `depth` deep (a word is 1 deep, AND(RED, CUBE) is 2).

    Every operator matters: no part of a program is true of all kinds of the design or of none, no
    operand of AND or OR can be omitted, and NOT is never doubled. No program has the meaning of a
    training program.
    """

    def __init__(self, design: Design, depth: int) -> None:
        self._design, self._depth = design, depth
        self._words = [Word(word) for word in design.words]
        self._kinds = [kind.words for kind in design.pool]
        self._trained = {tuple(kind == one for kind in design.pool) for one in design.train}

    def draw(self, target: Kind, others: int, rng: np.random.Generator) -> Program:
        """A program that names `target` and leaves at least `others` kinds of the design unnamed.

        Raises ArenaError (arena.episode) if TRIES draws give none.
        """
        index = self._design.pool.index(target)
        for _ in range(TRIES):
            expression, named = self._expression(self._depth, rng)
            if named[index] and named.count(False) >= others and named not in self._trained:
                return Program(expression)
        raise self._not_found(f"a program that names {target} and leaves {others} kinds unnamed")

    def _expression(self, depth: int, rng: np.random.Generator) -> tuple[Expression, Denotation]:
        if depth == 1:
            word = self._words[int(rng.integers(len(self._words)))]
            return word, self._denotation(word)
        for _ in range(TRIES):
            # One operand has the full depth; the other one may have any.
            operands = [self._expression(depth - 1, rng)]
            operator = int(rng.integers(3))
            if operator > 0:
                operands.append(self._expression(int(rng.integers(1, depth)), rng))
                operands = [operands[i] for i in rng.permutation(2)]
            expression = _combine(operator, [operand for operand, _ in operands])
            if expression is None:
                continue
            named = self._denotation(expression)
            # True of some kinds but not of all, and of others than each operand alone: it matters.
            if len(set(named)) == 2 and all(named != other for _, other in operands):
                return expression, named
        raise self._not_found(f"an expression {depth} deep in which every operator matters")

    def _denotation(self, expression: Expression) -> Denotation:
        return satisfying(Program(expression), self._kinds, None)

    def _not_found(self, expected: str) -> ArenaError:
        return ArenaError(
            f"programs {self._depth} deep for design {self._design.name}: expected {expected}, "
            f"found none in {TRIES} draws",
            code="arena.episode",
        )


def _combine(operator: int, operands: Sequence[Expression]) -> Expression | None:
    """NOT, AND or OR (0, 1, 2) of the operands; None for NOT of NOT."""
    if operator == 0:
        return None if isinstance(operands[0], Not) else Not(operands[0])
    return And(tuple(operands)) if operator == 1 else Or(tuple(operands))
