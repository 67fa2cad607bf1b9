"""Random programs of a given depth that identify one target, none of them like a training one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pa_ros.arena.designs import Design, Kind
from pa_ros.arena.errors import EpisodeError
from pa_ros.language import And, Expression, Not, Or, Program, Word, satisfying

TRIES = 10_000
Denotation = tuple[bool, ...]  # for each kind of a pool: does the expression describe it


class DeepPrograms:
    """Draws expressions over a design's words, `depth` deep (a word is 1, AND(RED, CUBE) is 2).

    Every operator matters: no part of a program is true of all kinds of the design or of none,
    no operand of AND or OR could be left out, and NOT is never doubled. Programs that mean the
    same as a training program are not drawn.
    """

    def __init__(self, design: Design, depth: int) -> None:
        self._design, self._depth = design, depth
        self._words = [Word(word) for word in design.words]
        self._kinds = [kind.words for kind in design.pool]
        self._trained = {tuple(kind == one for kind in design.pool) for one in design.train}

    def draw(self, target: Kind, others: int, rng: np.random.Generator) -> Program:
        """A program that names `target` and leaves at least `others` kinds of the design unnamed.

        Raises EpisodeError if TRIES draws give none.
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
            operands = [self._expression(depth - 1, rng)]
            operator = int(rng.integers(3))
            if operator > 0:
                operands.append(self._expression(int(rng.integers(1, depth)), rng))
                operands = [operands[i] for i in rng.permutation(2)]
            expression = _combined(operator, [operand for operand, _ in operands])
            if expression is None:
                continue
            named = self._denotation(expression)
            if len(set(named)) == 2 and all(named != other for _, other in operands):
                return expression, named
        raise self._not_found(f"an expression {depth} deep in which every operator matters")

    def _denotation(self, expression: Expression) -> Denotation:
        return satisfying(Program(expression), self._kinds, None)

    def _not_found(self, expected: str) -> EpisodeError:
        return EpisodeError(
            f"programs {self._depth} deep for design {self._design.name}: expected {expected}, "
            f"found none in {TRIES} draws"
        )


def _combined(operator: int, operands: Sequence[Expression]) -> Expression | None:
    """NOT, AND or OR (0, 1, 2) of the operands; None for NOT of NOT."""
    if operator == 0:
        return None if isinstance(operands[0], Not) else Not(operands[0])
    return And(tuple(operands)) if operator == 1 else Or(tuple(operands))
