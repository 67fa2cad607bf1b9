"""Conditions: how the episodes of one column of the generalization figure are drawn.

Each condition is data: the targets, how programs name them, and the other blocks (paper, section
"Strong generalization" and appendix "Referencing objects by exclusion"). The skill of a design has
the table of its conditions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache

from pa_ros.arena.designs import Design, Kind
from pa_ros.core.errors import ConfigError
from pa_ros.core.text import did_you_mean
from pa_ros.language import Program


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
    chain: int = 0  # programs of a THEN or an ALL; 0: a single program
    formula: bool = False  # a goal of `arena.formulas`, by the condition's name
    # The set to avoid is drawn from these; empty: nothing is avoided.
    avoided: tuple[Kind, ...] = ()
    avoided_set: str = "one"  # of them; "or": two of them; "not": all but the target
    avoided_share: float = 1.0  # of the episodes
    edges_m: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # empty: the design's
    near_starts: float = 0.0  # share of episodes that start with the hand beside the moved block
    in_tables: bool = True  # in tables of all conditions, which compare rewards

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
    """The programs of training episodes, by relation and then by target."""
    return design.skill.training_programs(design)


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
    return {condition.name: condition for condition in design.skill.conditions(design)}
