"""Draws the programs of a condition: how they name their targets, and which blocks they need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from pa_ros.arena.conditions import Condition, Term
from pa_ros.arena.designs import Design, Kind
from pa_ros.arena.errors import ArenaError
from pa_ros.language import And, Expression, Goal, Not, Or, Program, Then, Word, parse, satisfying

TRIES = 10_000  # draws of a longer program before it is given up

Denotation = tuple[bool, ...]
"""Whether an expression describes each kind of a pool."""


def program_for(
    condition: Condition, design: Design, target: Kind, rng: np.random.Generator
) -> tuple[Program, tuple[Kind, ...]]:
    """A program for a target, and the blocks that it needs besides the target."""
    relations = design.relations_for(target, condition.relations, condition.combinations)
    # A single relation uses no random number, so that the episodes of one relation are the same as
    # before there were several.
    relation = relations[int(rng.integers(len(relations))) if len(relations) > 1 else 0]
    if condition.depth:
        # Leave enough kinds unnamed to fill the table, but a program may name up to half of all
        # kinds.
        others = min(condition.n_blocks - 1, len(design.pool) // 2)
        program = DeepPrograms(design, condition.depth).draw(target, others, rng)
        return replace(program, relation=relation), ()
    if condition.named:
        choices = [
            (e, named) for e, named in expressions_for(design, condition.named) if target in named
        ]
        expression, named = choices[int(rng.integers(len(choices)))]
        rest = [kind for kind in named if kind != target]
        also = [rest[i] for i in rng.permutation(len(rest))[: condition.named - 1]]
        return _comparing(Program(expression, relation), condition, rng), tuple(also)
    terms, required = terms_for(design, target, condition.terms, rng)
    program = reaching_program(design, relation, *terms)
    if condition.compares:  # all that it names are compared
        pool = condition.pool
        bits = satisfying(program, [kind.words for kind in pool], None)
        required = [kind for kind, is_named in zip(pool, bits, strict=True)
                    if is_named and kind != target]  # fmt: skip
    return _comparing(program, condition, rng), tuple(required)


def _comparing(program: Program, condition: Condition, rng: np.random.Generator) -> Program:
    """The program with one of a condition's comparisons, if it has any."""
    if not condition.compares:
        return program
    comparison = condition.compares[int(rng.integers(len(condition.compares)))]
    return replace(program, chosen=("", comparison))


def expressions_for(design: Design, count: int) -> list[tuple[Expression, tuple[Kind, ...]]]:
    """Expressions of one word, NOT or OR that can name `count` blocks, and the kinds they name.

    Each leaves another kind unnamed, unless it is to name all blocks on the table.
    """
    words, pool = [Word(word) for word in design.words], design.pool
    pairs = map(Or, combinations(words, 2))
    expressions: list[Expression] = [*words, *map(Not, words), *pairs]
    found = []
    for expression in expressions:
        bits = satisfying(Program(expression), [kind.words for kind in pool], None)
        named = tuple(kind for kind, is_named in zip(pool, bits, strict=True) if is_named)
        if len(named) >= count and (len(named) < len(pool) or count == design.n_blocks):
            found.append((expression, named))
    return found


def chain_for(
    condition: Condition, design: Design, rng: np.random.Generator
) -> tuple[Goal, list[Kind]]:
    """A THEN of programs, each for another target than the one before, and the blocks it needs."""
    order = rng.permutation(len(condition.targets))[: condition.n_blocks]
    targets: list[Kind] = []
    while len(targets) < condition.chain:
        others = [condition.targets[i] for i in order if condition.targets[i] not in targets[-1:]]
        targets.append(others[int(rng.integers(len(others)))])
    drawn = [program_for(condition, design, target, rng) for target in targets]
    required = [kind for _, needed in drawn for kind in needed]
    return Then(tuple(program for program, _ in drawn)), [*dict.fromkeys((*targets, *required))]


def terms_for(
    design: Design, target: Kind, named_by: Mapping[str, Term], rng: np.random.Generator
) -> tuple[list[str], list[Kind]]:
    """The parts of a conjunction that names the target, and the blocks that they need."""
    required: list[Kind] = []
    terms: list[str] = []
    for group, known in design.values.items():
        own = target[group]
        match named_by.get(group, Term.NAMED):
            case Term.NAMED:
                terms.append(own)
            case Term.NOT_ANOTHER:
                other = str(rng.choice([word for word in known if word != own]))
                terms.append(f"NOT({other})")
                # Without this block on the table the negation would not matter.
                required.append(Kind(**{**target, group: other}))
            case Term.NOVEL:
                places = [w for w in design.vocabulary[group] if w in design.schema.bodiless]
                terms.append(novel((*known, *places), design.spare(group)))
            case Term.ANY:
                pass
    return terms, required


def reaching_program(design: Design, relation: str, *terms: str) -> Program:
    """The program that relates the hand to what all terms describe."""
    text = terms[0] if len(terms) == 1 else f"AND({', '.join(terms)})"
    return parse(f"{relation}(HAND, {text})", design.vocabulary)


def novel(known: tuple[str, ...], spare: tuple[str, ...]) -> str:
    """Describe objects without a known property: exclusion OR inclusion (paper, eq. 6)."""
    excluded = f"NOT({'OR(' + ', '.join(known) + ')' if len(known) > 1 else known[0]})"
    return f"OR({', '.join((excluded, *spare))})" if spare else excluded


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
