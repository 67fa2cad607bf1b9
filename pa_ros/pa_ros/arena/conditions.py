"""Conditions: how the episodes of one column of the generalization figure are drawn.

Each condition is data: the targets, how programs name them, and the other blocks (paper, section
"Strong generalization" and appendix "Referencing objects by exclusion").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from pa_ros.arena.designs import Design, Kind, kinds
from pa_ros.arena.errors import ArenaError
from pa_ros.core.errors import ConfigError
from pa_ros.core.text import did_you_mean
from pa_ros.language import And, Expression, Not, Or, Program, Word, parse, satisfying

DEPTHS = (3, 4, 5, 6)  # depths of the longer programs; training programs are 2 deep
TRIES = 10_000  # draws of a longer program before it is given up

Denotation = tuple[bool, ...]
"""For each kind of a pool: does the expression describe it?"""


class Term(Enum):
    """How a program refers to one property of its target."""

    NAMED = "named"  # RED
    ANY = "any"  # not mentioned; the other properties alone identify the target
    NOT_ANOTHER = "not another"  # NOT(BLUE); the same block in blue is on the table too
    NOVEL = "novel"  # OR(NOT(OR(RED, GREEN, BLUE)), A, B): by exclusion and by inclusion


@dataclass(frozen=True)
class Condition:
    """The targets of episodes, and how programs name them.

    The program of an episode always names exactly one block: the target.
    """

    name: str
    targets: tuple[Kind, ...]
    pool: tuple[Kind, ...]  # all blocks that may be on the table
    n_blocks: int
    terms: Mapping[str, Term] = field(default_factory=dict)  # by group; NAMED is the default
    new_distractor: bool = False  # at least one other block has a new property
    relations: tuple[str, ...] = ()  # of the programs; empty: all of the design's
    depth: int = 0  # 0: a conjunction of the terms; else a random program of this depth

    def __post_init__(self) -> None:
        if not self.targets:
            raise ConfigError(f"condition {self.name}: this design has no such target")
        if not 1 <= self.n_blocks <= len(self.pool):
            raise ConfigError(
                f"condition {self.name}: n_blocks: expected 1 to {len(self.pool)}, "
                f"got {self.n_blocks}"
            )


def training_programs(design: Design) -> tuple[Program, ...]:
    """The programs of training episodes, by relation and then by target."""
    return tuple(
        _program(design, relation, *kind.values())
        for relation in design.vocabulary.relations
        for kind in design.train
    )


def program_for(
    condition: Condition, design: Design, target: Kind, rng: np.random.Generator
) -> tuple[Program, tuple[Kind, ...]]:
    """A program for a target, and the blocks that it needs besides the target."""
    relations = condition.relations or design.vocabulary.relations
    # A single relation uses no random number, so that the episodes of one relation are the same as
    # before there were several.
    relation = relations[int(rng.integers(len(relations))) if len(relations) > 1 else 0]
    if condition.depth:
        # Leave enough kinds unnamed to fill the table, but a program may name up to half of all
        # kinds.
        others = min(condition.n_blocks - 1, len(design.pool) // 2)
        program = DeepPrograms(design, condition.depth).draw(target, others, rng)
        return replace(program, relation=relation), ()
    required: list[Kind] = []
    terms: list[str] = []
    for group, known in design.values.items():
        own = target[group]
        match condition.terms.get(group, Term.NAMED):
            case Term.NAMED:
                terms.append(own)
            case Term.NOT_ANOTHER:
                other = str(rng.choice([word for word in known if word != own]))
                terms.append(f"NOT({other})")
                # Without this block on the table the negation would not matter.
                required.append(Kind(**{**target, group: other}))
            case Term.NOVEL:
                terms.append(novel(known, design.spare(group)))
            case Term.ANY:
                pass
    return _program(design, relation, *terms), tuple(required)


def _program(design: Design, relation: str, *terms: str) -> Program:
    text = terms[0] if len(terms) == 1 else f"AND({', '.join(terms)})"
    return parse(f"{relation}(HAND, {text})", design.vocabulary)


def novel(known: tuple[str, ...], spare: tuple[str, ...]) -> str:
    """Describe objects without a known property: exclusion OR inclusion (paper, eq. 6)."""
    excluded = f"NOT({'OR(' + ', '.join(known) + ')' if len(known) > 1 else known[0]})"
    return f"OR({', '.join((excluded, *spare))})" if spare else excluded


def condition_named(name: str, design: Design) -> Condition:
    """Build a condition for a design; ConfigError if the design has no such condition.

    Zero-shot conditions use the held-out targets, or the training targets if nothing is held out.
    """
    conditions = _conditions(design)
    if name in conditions:
        return conditions[name]
    raise ConfigError(
        f"design {design.name}: expected a condition of {sorted(conditions)}, got {name!r}"
        f"{did_you_mean(name, conditions)}"
    )


def conditions_for(design: Design) -> tuple[str, ...]:
    """Names of the conditions of a design."""
    return tuple(_conditions(design))


def _conditions(design: Design) -> dict[str, Condition]:
    pool, wider, n = design.pool, design.extended_pool, design.n_blocks
    zero_shot = design.held_out or design.train
    varied = [group for group, values in design.values.items() if len(values) > 1]
    found = [Condition("train", design.train, pool, n)]
    if design.held_out:
        found.append(Condition("eval", design.held_out, pool, n))
    if len(design.values) > 1:
        for group in design.values:
            others = {other: Term.ANY for other in design.values if other != group}
            found.append(Condition(f"only-{group}", pool, pool, n, others))
    found += [
        Condition(f"not-{group}", pool, pool, n, {group: Term.NOT_ANOTHER}) for group in varied
    ]
    found += [
        Condition(f"blocks-{count}", zero_shot, pool, count)
        for count in range(2, min(8, len(pool)) + 1)
    ]
    if design.novel:
        found.append(Condition("ignore-new", zero_shot, wider, n, new_distractor=True))
    found += _reach_new(design, wider, n)
    found += _by_relation(design, n)
    if len(varied) > 1:
        found += [Condition(f"depth-{depth}", pool, pool, n, depth=depth) for depth in DEPTHS]
    return {condition.name: condition for condition in found}


def _by_relation(design: Design, n: int) -> list[Condition]:
    """Training and held-out targets by relation, for designs with several relations."""
    parts = (("train", design.train), ("eval", design.held_out))
    return [
        Condition(f"{part}-{relation.lower().replace('_', '-')}", targets, design.pool, n,
                  relations=(relation,))
        for part, targets in parts if targets
        for relation in design.vocabulary.relations if len(design.vocabulary.relations) > 1
    ]  # fmt: skip


def _reach_new(design: Design, pool: tuple[Kind, ...], n: int) -> list[Condition]:
    """Targets with a new property, for groups that have spare words in the vocabulary."""
    groups = [g.name for g in design.schema if g.name in design.novel and design.spare(g.name)]
    together = [groups] if len(groups) > 1 else []
    found = []
    for new in [*([group] for group in groups), *together]:
        name = new[0] if len(new) == 1 else "both" if len(new) == 2 else "all"
        values = {g: (design.novel[g],) if g in new else v for g, v in design.values.items()}
        terms = dict.fromkeys(new, Term.NOVEL)
        found.append(Condition(f"reach-new-{name}", kinds(values), pool, n, terms))
    return found


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
