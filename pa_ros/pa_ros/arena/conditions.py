"""Conditions: how the episodes of one column of the generalization figure are drawn.

Each condition is data: the targets, how programs name them, and the other blocks (paper, section
"Strong generalization" and appendix "Referencing objects by exclusion").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import lru_cache
from itertools import combinations, product
from typing import Any

import numpy as np

from pa_ros.arena.designs import Design, Kind, kinds
from pa_ros.arena.errors import ArenaError
from pa_ros.arena.formulas import FORMULAS, ZONES, goal_of
from pa_ros.core.errors import ConfigError
from pa_ros.core.text import did_you_mean
from pa_ros.language import (
    HAND,
    And,
    Expression,
    Goal,
    Not,
    Or,
    Program,
    Then,
    Word,
    parse,
    satisfying,
)
from pa_ros.language.syntax import NEAR, OF_PLACES, OF_SIZES, SIZE

SEVERAL = (1, 2, 3)  # blocks named in the conditions `several-…`; `several-all` names all
CHAINS = (2, 4, 8)  # programs of a THEN
# Comparisons: the end of the condition's name, blocks on the table, and how many are compared.
Compared = tuple[str, int, int]
COMPARED: tuple[Compared, ...] = (("", 4, 2), ("-8", 8, 4))
SIZES_COMPARED: tuple[Compared, ...] = (("-2", 2, 2), ("-8", 8, 4), ("-unseen", 8, 4))
DEPTHS = (3, 4, 5, 6)  # depths of the longer programs; training programs are 2 deep
NEAR_STARTS = 0.5  # in training: then random actions push the block, and learning can begin
TRIES = 10_000  # draws of a longer program before it is given up

Denotation = tuple[bool, ...]
"""Whether an expression describes each kind of a pool."""


class Term(Enum):
    """How a program refers to one property of its target."""

    NAMED = "named"  # RED
    ANY = "any"  # not mentioned; the other properties alone identify the target
    NOT_ANOTHER = "not another"  # NOT(BLUE); the same block in blue is on the table too
    NOVEL = "novel"  # OR(NOT(OR(RED, GREEN, BLUE)), A, B): by exclusion and by inclusion


@dataclass(frozen=True)
class Condition:
    """The targets of episodes, and how programs name them.

    The program of an episode names exactly one block, the target, unless `named` says more. If
    blocks are to be moved, it names one such block too, and targets may be places.
    """

    name: str
    targets: tuple[Kind, ...]
    pool: tuple[Kind, ...]  # all blocks that may be on the table
    n_blocks: int
    terms: Mapping[str, Term] = field(default_factory=dict)  # by group; NAMED is the default
    new_distractor: bool = False  # at least one other block has a new property
    relations: tuple[str, ...] = ()  # of the programs; empty: all of the design's
    # Of relation and target: True: only held-out ones; False: none of them; None: any.
    combinations: bool | None = None
    depth: int = 0  # 0: a conjunction of the terms; else a random program of this depth
    named: int = 0  # blocks that a program of one word, NOT or OR names; 0: a program of the terms
    compares: tuple[str, ...] = ()  # of the named blocks one is meant, by one of these comparisons
    moved: tuple[Kind, ...] = ()  # blocks to be moved; empty: the hand
    moved_terms: Mapping[str, Term] = field(default_factory=dict)  # how programs name them
    # "moved", "target": its argument is an OR with another present object
    either: tuple[str, ...] = ()
    chain: int = 0  # programs of a THEN; 0: a single program
    formula: bool = False  # a goal of `arena.formulas`, by the condition's name
    # The set to avoid is drawn from these; empty: nothing is avoided.
    avoided: tuple[Kind, ...] = ()
    avoids: str = "one"  # of them; "or": two of them; "not": all but the target
    avoiding: float = 1.0  # share of episodes that avoid something
    edges_m: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # empty: the design's
    near_starts: float = 0.0  # share of episodes that start with the hand beside the moved block

    def __post_init__(self) -> None:
        if not self.targets:
            raise ConfigError(f"condition {self.name}: this design has no such target")
        if not 1 <= self.n_blocks <= len(self.pool):
            raise ConfigError(
                f"condition {self.name}: n_blocks: expected 1 to {len(self.pool)}, "
                f"got {self.n_blocks}"
            )

    def tells(self, target: Kind, moved: Kind | None) -> bool:
        """Whether a program can name a target without naming the block that is to be moved."""
        named = [group for group in target if self.terms.get(group, Term.NAMED) is Term.NAMED]
        return moved is None or any(target[group] != moved[group] for group in named)


def training_programs(design: Design) -> tuple[Program, ...]:
    """The programs of training episodes, by relation and then by target.

    If blocks are to be moved: programs that move each training block to each place (and to each
    other training block), then those that reach for each block and place.
    """
    if design.vocabulary.moves_objects:
        goals = _goals(design)
        moves = [(kind.conjunction, goal) for kind, goal in product(design.train, goals)
                 if kind != goal]  # fmt: skip
        reaches = [(HAND.name, kind) for kind in (*design.train, *design.places)]
        return tuple(
            parse(f"{relation}({moved}, {target.conjunction})", design.vocabulary)
            for relation in design.vocabulary.relations
            for moved, target in (*moves, *reaches)
        )
    return tuple(
        _program(design, relation, *kind.values())
        for relation in design.vocabulary.relations
        for kind in design.train
        if design.trains(relation, kind)
    )


def _asked(
    design: Design, target: Kind, relations: tuple[str, ...], combinations: bool | None
) -> tuple[str, ...]:
    """The relations of programs for a target; the arguments are those of a condition."""
    return tuple(
        relation
        for relation in relations or design.vocabulary.relations
        if combinations in (None, not design.trains(relation, target))
    )


def _goals(design: Design) -> tuple[Kind, ...]:
    """The targets to which training programs move blocks."""
    return (*design.places, *(design.train if design.pairs else ()))


def program_for(
    condition: Condition, design: Design, target: Kind, rng: np.random.Generator
) -> tuple[Program, tuple[Kind, ...]]:
    """A program for a target, and the blocks that it needs besides the target."""
    relations = _asked(design, target, condition.relations, condition.combinations)
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
        choices = [(e, named) for e, named in _short(design, condition.named) if target in named]
        expression, named = choices[int(rng.integers(len(choices)))]
        rest = [kind for kind in named if kind != target]
        also = [rest[i] for i in rng.permutation(len(rest))[: condition.named - 1]]
        return _comparing(Program(expression, relation), condition, rng), tuple(also)
    terms, required = _terms(design, target, condition.terms, rng)
    program = _program(design, relation, *terms)
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


def _short(design: Design, count: int) -> list[tuple[Expression, tuple[Kind, ...]]]:
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


def formula_for(
    condition: Condition, design: Design, rng: np.random.Generator
) -> tuple[Goal, list[Kind]]:
    """The goal of a condition with a formula, and its blocks."""
    blocks = [condition.targets[i] for i in rng.permutation(len(condition.targets))[: len(ZONES)]]
    zones = dict(zip(ZONES, blocks, strict=True))
    return goal_of(condition.name, zones, design.vocabulary), blocks


def avoiding(
    condition: Condition, design: Design, program: Program, target: Kind, rng: np.random.Generator
) -> tuple[Program, list[Kind]]:
    """A program with a set to avoid, as a condition says, and the blocks that the set needs."""
    if rng.random() >= condition.avoiding:
        return program, []
    others = [kind for kind in condition.avoided if kind != target]
    count = 2 if condition.avoids == "or" else 1
    chosen = [others[i] for i in rng.permutation(len(others))[:count]]
    parts = [_program(design, NEAR, *kind.values()).target for kind in chosen]
    avoided = parts[0] if len(parts) == 1 else Or(tuple(parts))
    if condition.avoids == "not":
        avoided = Not(program.target)
    return replace(program, avoided=avoided), chosen


def moving_program(
    condition: Condition,
    design: Design,
    moved: Kind | None,
    target: Kind,
    rng: np.random.Generator,
) -> tuple[Program, tuple[Kind, ...]]:
    """A program that relates a block, or the hand, to a target, and the objects that it needs
    besides them."""
    relations = condition.relations or design.vocabulary.relations
    relation = relations[int(rng.integers(len(relations)))]
    needed: list[Kind] = []

    def argument(kind: Kind, name: str, terms: Mapping[str, Term], others: Sequence[Kind]) -> str:
        if name in condition.either:
            rest = [one for one in others if one not in (moved, target)]
            needed.append(rest[int(rng.integers(len(rest)))])
            return f"OR({kind.conjunction}, {needed[-1].conjunction})"
        if condition.depth and name == "moved":
            few = len(design.pool) // 2
            return str(DeepPrograms(design, condition.depth).draw(kind, few, rng).target)
        words, required = _terms(design, kind, terms, rng)
        needed.extend(required)
        return words[0] if len(words) == 1 else f"AND({', '.join(words)})"

    first = HAND.name
    if moved is not None:
        first = argument(moved, "moved", condition.moved_terms, condition.pool)
    others = condition.pool if design.schema.has_body(target) else design.places
    second = argument(target, "target", condition.terms, others)
    return parse(f"{relation}({first}, {second})", design.vocabulary), tuple(needed)


def _terms(
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


@lru_cache(maxsize=64)
def _conditions(design: Design) -> Mapping[str, Condition]:
    if design.vocabulary.moves_objects:
        return {condition.name: condition for condition in _moving_conditions(design)}
    pool, wider, n = design.pool, design.extended_pool, design.n_blocks
    zero_shot = design.held_out or design.train
    varied = [group for group, values in design.values.items() if len(values) > 1]
    trained = tuple(kind for kind in design.train if _asked(design, kind, (), False))
    sets = trained if design.vocabulary.avoids else ()
    found = [Condition("train", trained, pool, n, combinations=False, avoided=sets, avoiding=0.5)]
    if design.vocabulary.avoids:
        found += [
            Condition("avoid", zero_shot, pool, n, avoided=zero_shot),
            Condition("avoid-train", trained, pool, n, avoided=trained),
            Condition("avoid-target", zero_shot, pool, n, avoided=trained),
            Condition("avoid-set", trained, pool, n, avoided=zero_shot),
            Condition("avoid-or", zero_shot, pool, n, avoided=pool, avoids="or"),
            Condition("avoid-not", zero_shot, pool, n, avoided=pool, avoids="not"),
            *(Condition(name, pool, pool, len(ZONES), formula=True) for name in FORMULAS),
        ]
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
    if len(zero_shot) > 1:
        found += [Condition(f"chain-{count}", zero_shot, pool, n, chain=count) for count in CHAINS]
    found += _reach_new(design, wider, n)
    found += _by_relation(design, n)
    if len(varied) > 1:
        found += [Condition(f"depth-{depth}", pool, pool, n, depth=depth) for depth in DEPTHS]
    for name, count in (*((str(k), k) for k in SEVERAL if k < n), ("all", n)):
        nameable = {kind for _, named in _short(design, count) for kind in named}
        targets = tuple(kind for kind in pool if kind in nameable)
        if targets:
            found.append(Condition(f"several-{name}", targets, pool, n, named=count))
    found += _comparing_conditions(design)
    return {condition.name: condition for condition in found}


def _comparing_conditions(design: Design) -> list[Condition]:
    """Conditions of comparisons: of places, and of sizes where they are drawn."""
    found, pool = [], design.pool
    cases: list[tuple[str, tuple[str, ...], Compared]]
    cases = [("compare", OF_PLACES, one) for one in COMPARED]
    if design.edges_m:
        cases += [("compare-size", OF_SIZES, one) for one in SIZES_COMPARED]
        targets, any_size = design.held_out or design.train, {SIZE: Term.ANY}
        unseen = design.unseen_edges_m
        found.append(Condition("compare-size", targets, pool, design.n_blocks, any_size,
                               compares=OF_SIZES))  # fmt: skip
        found.append(Condition("eval-unseen", targets, pool, design.n_blocks, edges_m=unseen))
    for start, comparisons, (end, count, named) in cases:
        nameable = {kind for _, several in _short(design, named) for kind in several}
        targets = tuple(kind for kind in pool if kind in nameable)
        if targets and count <= len(pool):
            edges = design.unseen_edges_m if end == "-unseen" else {}
            found.append(Condition(start + end, targets, pool, count, named=named,
                                   compares=comparisons, edges_m=edges))  # fmt: skip
    return found


def _moving_conditions(design: Design) -> list[Condition]:
    """Conditions of programs that move blocks: to places, except in `pairs…` and `reach…`."""
    pool, places, n = design.pool, design.places, design.n_blocks
    zero_shot = design.held_out or design.train

    def condition(name: str, targets: Sequence[Kind] = places, **changed: Any) -> Condition:
        return Condition(name, tuple(targets), **{"pool": pool, "n_blocks": n, **changed})

    found = [
        condition("train", _goals(design), moved=design.train, near_starts=NEAR_STARTS),
        condition("eval", moved=zero_shot),
        condition("pairs", pool, moved=pool),
        condition("pairs-train", design.train, moved=design.train),
        condition("pairs-eval", pool, moved=zero_shot),
        condition("reach", (*design.train, *places)),
        condition("reach-eval", zero_shot),
        condition("moved-or", moved=pool, either=("moved",)),
        condition("target-or", moved=pool, either=("target",)),
        condition("depth-3", moved=pool, depth=3),
        condition("target-only-shape", moved=pool, terms={"color": Term.ANY}),
        condition("target-only-color", pool, moved=pool, terms={"shape": Term.ANY}),
        condition("target-not-color", moved=pool, terms={"color": Term.NOT_ANOTHER}),
        condition("target-not-shape", pool, moved=pool, terms={"shape": Term.NOT_ANOTHER}),
    ]
    for group in design.values:
        others = {other: Term.ANY for other in design.values if other != group}
        found += [
            condition(f"moved-only-{group}", moved=pool, moved_terms=others),
            condition(f"moved-not-{group}", moved=pool, moved_terms={group: Term.NOT_ANOTHER}),
        ]
        if design.spare(group) and group in design.novel:
            new = kinds({**design.values, group: (design.novel[group],)})
            wide, terms = design.extended_pool, {group: Term.NOVEL}
            found += [
                condition(f"moved-new-{group}", moved=new, moved_terms=terms, pool=wide),
                condition(f"target-new-{group}", new, moved=design.train, terms=terms, pool=wide),
            ]
    for count in range(3, min(6, len(pool)) + 1):
        found.append(condition(f"blocks-{count}", moved=zero_shot, n_blocks=count))
    if len(design.vocabulary.relations) > 1:
        for relation in design.vocabulary.relations:
            name, only = relation.lower().replace("_", "-"), (relation,)
            found += [
                condition(f"train-{name}", moved=design.train, relations=only),
                condition(f"eval-{name}", moved=zero_shot, relations=only),
                condition(f"pairs-{name}", pool, moved=pool, relations=only),
            ]
    return found


def _by_relation(design: Design, n: int) -> list[Condition]:
    """Held-out combinations of relation and target, and the conditions of a single relation, for
    designs with several."""
    relations = design.vocabulary.relations
    parts: list[tuple[str, tuple[Kind, ...], bool | None]] = [
        ("train", design.train, False),
        ("eval", design.held_out, None),
    ]
    if design.held_out_combinations:
        parts.append(("eval-combinations", design.train, True))
    found = []
    for part, targets, held_out in parts:
        several = [(relation,) for relation in relations if len(relations) > 1]
        for asked in ((), *several) if held_out else several:
            name = "-".join((part, *(relation.lower().replace("_", "-") for relation in asked)))
            of = tuple(kind for kind in targets if _asked(design, kind, asked, held_out))
            if of:
                found.append(Condition(name, of, design.pool, n, relations=asked,
                                       combinations=held_out))  # fmt: skip
    return found


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
