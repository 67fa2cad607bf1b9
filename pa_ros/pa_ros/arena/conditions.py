"""Conditions: how the episodes of one column of the generalization figure are drawn.

Each is data: from which targets, named how, among which other blocks, and how many (paper,
section "Strong generalization" and appendix "Referencing objects by exclusion").
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from pa_ros.arena.deep_programs import DeepPrograms
from pa_ros.arena.designs import Design, Kind, kinds
from pa_ros.core.errors import ConfigError
from pa_ros.language import Program, parse

DEPTHS = (3, 4, 5, 6)  # of the conditions with longer programs; in training they are 2 deep


class Term(Enum):
    """How a program refers to one property of its target."""

    NAMED = "named"  # RED
    ANY = "any"  # not mentioned; then the other properties alone identify the target
    NOT_ANOTHER = "not another"  # NOT(BLUE), with the blue one on the table that else is the same
    NOVEL = "novel"  # OR(NOT(OR(RED, GREEN, BLUE)), A, B): by exclusion and by inclusion


@dataclass(frozen=True)
class Condition:
    """Where targets come from and how programs name them.

    Whatever the terms, the program names exactly one block of the episode: the target.
    """

    name: str
    targets: tuple[Kind, ...]
    pool: tuple[Kind, ...]  # all blocks that may be on the table
    n_blocks: int
    terms: Mapping[str, Term] = field(default_factory=dict)  # by group; NAMED where there is none
    new_distractor: bool = False  # at least one other block has a new property
    relations: tuple[str, ...] = ()  # that programs ask for; none: all of the design's
    depth: int = 0  # 0: a conjunction as the terms say; else a random program this deep

    def __post_init__(self) -> None:
        if not self.targets:
            raise ConfigError(f"condition {self.name}: this design has no such target")
        if not 1 <= self.n_blocks <= len(self.pool):
            raise ConfigError(
                f"condition {self.name}: n_blocks: expected 1 to {len(self.pool)}, "
                f"got {self.n_blocks}"
            )


def training_programs(design: Design) -> tuple[Program, ...]:
    """The programs that training episodes draw from: relation by relation, target by target."""
    return tuple(
        _program(design, relation, *kind.values())
        for relation in design.vocabulary.relations
        for kind in design.train
    )


def program_for(
    condition: Condition, design: Design, target: Kind, rng: np.random.Generator
) -> tuple[Program, tuple[Kind, ...]]:
    """Program for a target, and the blocks that must be present for it to mean something."""
    relation = _drawn(condition.relations or design.vocabulary.relations, rng)
    if condition.depth:
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
                required.append(target.but(**{group: other}))
            case Term.NOVEL:
                terms.append(novel(known, design.spare(group)))
            case Term.ANY:
                pass
    return _program(design, relation, *terms), tuple(required)


def _drawn(relations: tuple[str, ...], rng: np.random.Generator) -> str:
    """One of them; where there is one alone, nothing is drawn."""
    return relations[int(rng.integers(len(relations))) if len(relations) > 1 else 0]


def _program(design: Design, relation: str, *terms: str) -> Program:
    text = terms[0] if len(terms) == 1 else f"AND({', '.join(terms)})"
    return parse(f"{relation}(HAND, {text})", design.vocabulary)


def novel(known: tuple[str, ...], spare: tuple[str, ...]) -> str:
    """Name what has no known property of a group: exclusion OR inclusion (paper, eq. 6)."""
    excluded = f"NOT({'OR(' + ', '.join(known) + ')' if len(known) > 1 else known[0]})"
    return f"OR({', '.join((excluded, *spare))})" if spare else excluded


def condition_named(name: str, design: Design, n_blocks: int | None = None) -> Condition:
    """Build a condition for a design; ConfigError if unknown, or if it means nothing there.

    `n_blocks` replaces the design's number of blocks, except where the condition sets it.
    Zero-shot conditions use the held-out targets, or the training ones if nothing is held out.
    """
    conditions = _conditions(design, n_blocks or design.n_blocks)
    if name in conditions:
        return conditions[name]
    raise ConfigError(
        f"design {design.name}: expected a condition of {sorted(conditions)}, got {name!r}"
    )


def conditions_for(design: Design) -> tuple[str, ...]:
    """Names of the conditions that this design can be evaluated under."""
    return tuple(_conditions(design, design.n_blocks))


def _conditions(design: Design, n: int) -> dict[str, Condition]:
    pool, wider = design.pool, design.extended_pool
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
    """Training and held-out targets of one relation each, where programs ask for several."""
    parts = (("train", design.train), ("eval", design.held_out))
    return [
        Condition(f"{part}-{relation.lower().replace('_', '-')}", targets, design.pool, n,
                  relations=(relation,))
        for part, targets in parts if targets
        for relation in design.vocabulary.relations if len(design.vocabulary.relations) > 1
    ]  # fmt: skip


def _reach_new(design: Design, pool: tuple[Kind, ...], n: int) -> list[Condition]:
    """Targets with a new property; only where the vocabulary has words to spare for it."""
    groups = [g.name for g in design.schema if g.name in design.novel and design.spare(g.name)]
    together = [groups] if len(groups) > 1 else []
    found = []
    for new in [*([group] for group in groups), *together]:
        name = new[0] if len(new) == 1 else "both" if len(new) == 2 else "all"
        values = {g: (design.novel[g],) if g in new else v for g, v in design.values.items()}
        terms = dict.fromkeys(new, Term.NOVEL)
        found.append(Condition(f"reach-new-{name}", kinds(values), pool, n, terms))
    return found
