"""Avoiding: programs that move the hand to a block, while it stays away from others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import inf

import numpy as np

from pa_ros.arena.conditions import Condition
from pa_ros.arena.designs import Design
from pa_ros.arena.drawn_programs import reaching_program
from pa_ros.arena.formulas import FORMULAS, ZONES, ZONES_APART_M, goal_of
from pa_ros.arena.reaching import Reaching, Wanted, trained
from pa_ros.arena.skills import SKILLS
from pa_ros.language import Not, Or, Program
from pa_ros.language.syntax import NEAR

AVOID_WITHIN_M = 0.30  # from the target to what is to be avoided, so that it is in the way


class Avoiding(Reaching):
    """Moves the hand to blocks, and learns to stay away from others."""

    def conditions(self, design: Design) -> Iterator[Condition]:
        train, *others = super().conditions(design)
        yield train
        yield from _avoiding(design)
        yield from others

    def train(self, design: Design) -> Condition:
        return replace(super().train(design), avoided=trained(design), avoided_share=0.5)

    def want(self, design: Design, condition: Condition, rng: np.random.Generator) -> Wanted:
        if condition.formula:
            return _formula(design, condition, rng)
        wanted = super().want(design, condition, rng)
        if not condition.avoided or rng.random() >= condition.avoided_share:
            return wanted
        return _avoid(design, condition, wanted, rng)


SKILLS.register("avoid", Avoiding())


def _avoiding(design: Design) -> Iterator[Condition]:
    """Conditions that avoid a set: which target, and what is avoided."""
    pool, n, known = design.pool, design.n_blocks, trained(design)
    new = design.held_out or design.train
    for name, targets, avoided, avoided_set in (
        ("avoid", new, new, "one"),
        ("avoid-train", known, known, "one"),
        ("avoid-target", new, known, "one"),
        ("avoid-set", known, new, "one"),
        ("avoid-or", new, pool, "or"),
        ("avoid-not", new, pool, "not"),
    ):
        yield Condition(name, targets, pool, n, avoided=avoided, avoided_set=avoided_set,
                        in_tables=False)  # fmt: skip
    # Goals over time of published formulas.
    for name in FORMULAS:
        yield Condition(name, pool, pool, len(ZONES), formula=True, in_tables=False)


def _formula(design: Design, condition: Condition, rng: np.random.Generator) -> Wanted:
    """The goal of a condition with a formula, for blocks that are far from each other."""
    blocks = [condition.targets[i] for i in rng.permutation(len(condition.targets))[: len(ZONES)]]
    zones = dict(zip(ZONES, blocks, strict=True))
    goal = goal_of(condition.name, zones, design.vocabulary)
    return Wanted(goal, blocks, apart_m=ZONES_APART_M)


def _avoid(
    design: Design, condition: Condition, wanted: Wanted, rng: np.random.Generator
) -> Wanted:
    """The same with a set to avoid, as a condition says, and the blocks that the set needs."""
    program, (target, *others) = wanted.goal, wanted.needed
    assert isinstance(program, Program)
    among = [kind for kind in condition.avoided if kind != target]
    count = 2 if condition.avoided_set == "or" else 1
    chosen = [among[i] for i in rng.permutation(len(among))[:count]]
    parts = [reaching_program(design, NEAR, *kind.values()).target for kind in chosen]
    avoided = parts[0] if len(parts) == 1 else Or(tuple(parts))
    if condition.avoided_set == "not":
        avoided = Not(program.target)
    needed = [target, *dict.fromkeys((*others, *chosen))]
    within_m = AVOID_WITHIN_M if chosen else inf
    return Wanted(replace(program, avoided=avoided), needed, within_m)
