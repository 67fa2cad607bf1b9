"""Reaching: programs that move the hand to a block (paper)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import hypot, inf, pi

import numpy as np
from numpy.typing import NDArray

from pa_ros.arena.arms import ARMS
from pa_ros.arena.conditions import Condition, Term
from pa_ros.arena.config import ArenaConfig
from pa_ros.arena.designs import Design, Kind, kinds
from pa_ros.arena.drawn_programs import chain_for, expressions_for, program_for, reaching_program
from pa_ros.arena.episodes import PLACEMENT_TRIES, Block, Episode, Spot, spots_for
from pa_ros.arena.references import nearest_target, reach
from pa_ros.arena.skills import SKILLS, DemoProgram, Skill, two_alike
from pa_ros.arena.task import ReachTask, world_of
from pa_ros.core.experience import Float64
from pa_ros.language import Goal, Program, satisfying, stages
from pa_ros.language.syntax import OF_PLACES, OF_SIZES, SIZE

SEVERAL = (1, 2, 3)  # blocks named in the conditions `several-…`; `several-all` names all
CHAINS = (2, 4, 8)  # programs of a THEN
DEPTHS = (3, 4, 5, 6)  # depths of the longer programs; training programs are 2 deep
# Comparisons: the end of the condition's name, blocks on the table, and how many are compared.
Compared = tuple[str, int, int]
COMPARED: tuple[Compared, ...] = (("", 4, 2), ("-8", 8, 4))
SIZES_COMPARED: tuple[Compared, ...] = (("-2", 2, 2), ("-8", 8, 4), ("-unseen", 8, 4))


@dataclass(frozen=True)
class Wanted:
    """The goal of an episode, and what it asks of the blocks."""

    goal: Goal
    needed: list[Kind]  # on the table; the first target comes first
    # Lengths where NEAR has its usual threshold.
    within_m: float = inf  # from the first needed block to the second
    apart_m: float = 0.0  # least distance between two blocks; the arena's if that is more


class Reaching(Skill):
    """Moves the hand to blocks."""

    does = "cannot push or grasp"
    demo_conditions = "eval", "only-color"

    def training_programs(self, design: Design) -> tuple[Program, ...]:
        return tuple(
            reaching_program(design, relation, *kind.values())
            for relation in design.vocabulary.relations
            for kind in design.train
            if design.trains(relation, kind)
        )

    def conditions(self, design: Design) -> Iterator[Condition]:
        """Zero-shot conditions use the held-out targets, or the training targets if nothing is held
        out."""
        pool, n = design.pool, design.n_blocks
        zero_shot = design.held_out or design.train
        varied = [group for group, values in design.values.items() if len(values) > 1]
        # A training target.
        yield self.train(design)
        # Properties that identify the target: all of a held-out one, or one of any.
        if design.held_out:
            yield Condition("eval", design.held_out, pool, n)
        if len(design.values) > 1:
            for group in design.values:
                others = {other: Term.ANY for other in design.values if other != group}
                yield Condition(f"only-{group}", pool, pool, n, others)
        # Not another property: the same block with that one is on the table, too.
        for group in varied:
            yield Condition(f"not-{group}", pool, pool, n, {group: Term.NOT_ANOTHER})
        # Another number of blocks.
        for count in range(2, min(8, len(pool)) + 1):
            yield Condition(f"blocks-{count}", zero_shot, pool, count, in_tables=False)
        # At least one other block has a new property.
        if design.novel:
            wider = design.extended_pool
            yield Condition("ignore-new", zero_shot, wider, n, new_distractor=True)
        # Several targets, one after the other.
        if len(zero_shot) > 1:
            for count in CHAINS:
                yield Condition(f"chain-{count}", zero_shot, pool, n, chain=count, in_tables=False)
        yield from _new(design)
        yield from _by_relation(design)
        # Random programs.
        if len(varied) > 1:
            for depth in DEPTHS:
                yield Condition(f"depth-{depth}", pool, pool, n, depth=depth)
        # One word, NOT or OR that names several blocks.
        for name, count in (*((str(k), k) for k in SEVERAL if k < n), ("all", n)):
            if targets := _named_by_one_of(design, count):
                yield Condition(f"several-{name}", targets, pool, n, named=count)
        yield from _comparing(design)

    def train(self, design: Design) -> Condition:
        """The condition of training."""
        return Condition("train", trained(design), design.pool, design.n_blocks, combinations=False)

    def draw(
        self,
        config: ArenaConfig,
        design: Design,
        condition: Condition,
        index: int,
        rng: np.random.Generator,
    ) -> Episode:
        """Blocks are in random order, and the program names exactly one, or `condition.named`.

        There are fewer than `condition.n_blocks` if the design has too few kinds that the program
        does not name.
        """
        # The order of the draws must not change, because every published result depends on it.
        base = float(rng.uniform(config.joint_lower[0], config.joint_upper[0]))
        wanted = self.want(design, condition, rng)
        longer = world_of(config, design).nearness
        wanted = replace(wanted, within_m=wanted.within_m * longer, apart_m=wanted.apart_m * longer)
        words = [kind.words for kind in condition.pool]
        named = np.any([satisfying(one, words, None) for one in stages(wanted.goal)], axis=0)
        unnamed = [k for k, is_named in zip(condition.pool, named, strict=True) if not is_named]
        chosen = [*wanted.needed, *_distractors(condition, design, unnamed, wanted.needed, rng)]
        order = rng.permutation(len(chosen))
        blocks = tuple(
            Block(chosen[i], x, y, float(rng.uniform(-pi, pi)))
            for i, (x, y) in zip(order, _spots(config, order, wanted, rng), strict=True)
        )
        if edges := condition.edges_m or design.edges_m:
            drawn = [float(rng.uniform(*edges[block.kind[SIZE]])) for block in blocks]
            blocks = tuple(replace(b, edge_m=m) for b, m in zip(blocks, drawn, strict=True))
        start = base, *(joint.start for joint in ARMS[config.arm].joints[1:])
        return Episode(index, condition.name, blocks, start, wanted.goal)

    def want(self, design: Design, condition: Condition, rng: np.random.Generator) -> Wanted:
        """Draw the goal of an episode."""
        if condition.chain:
            return Wanted(*chain_for(condition, design, rng))
        target = condition.targets[int(rng.integers(len(condition.targets)))]
        program, needed = program_for(condition, design, target, rng)
        return Wanted(program, [target, *needed])

    def script(self, task: ReachTask) -> Float64:
        return reach(task, nearest_target(task))

    def demo(self, design: Design) -> list[DemoProgram]:
        first, last = [*design.values][0], [*design.values][-1]
        (known, other), new = two_alike(design.train, last), design.held_out[0]
        trained, held_out = known.conjunction, new.conjunction
        without = f"AND({', '.join([f'NOT({known[first]})', *[*other.values()][1:]])})"
        relation = design.vocabulary.relations[0]
        return [
            DemoProgram("trained", f"{relation}(HAND, {trained})"),
            DemoProgram("held out", f"{relation}(HAND, {held_out})"),
            DemoProgram(f"{first} alone", f"{relation}(HAND, {known[first]})"),
            DemoProgram(f"{last} alone", f"{relation}(HAND, {new[last]})"),
            DemoProgram("NOT", f"{relation}(HAND, {without})"),
            DemoProgram("OR of two", f"{relation}(HAND, OR({trained}, {held_out}))", targets=2),
        ]


SKILLS.register("reach", Reaching())


def trained(design: Design) -> tuple[Kind, ...]:
    """The training targets that some training program names."""
    return tuple(kind for kind in design.train if design.relations_for(kind, held_out=False))


def _new(design: Design) -> Iterator[Condition]:
    """Targets with a new property, for groups that have spare words in the vocabulary."""
    groups = [g.name for g in design.schema if g.name in design.novel and design.spare(g.name)]
    together = [groups] if len(groups) > 1 else []
    for new in [*([group] for group in groups), *together]:
        name = new[0] if len(new) == 1 else "both" if len(new) == 2 else "all"
        values = {g: (design.novel[g],) if g in new else v for g, v in design.values.items()}
        terms, pool = dict.fromkeys(new, Term.NOVEL), design.extended_pool
        yield Condition(f"reach-new-{name}", kinds(values), pool, design.n_blocks, terms)


def _by_relation(design: Design) -> Iterator[Condition]:
    """Held-out combinations of relation and target, and the conditions of a single relation, for
    designs with several."""
    relations = design.vocabulary.relations
    parts: list[tuple[str, tuple[Kind, ...], bool | None]] = [
        ("train", design.train, False),
        ("eval", design.held_out, None),
    ]
    if design.held_out_combinations:
        parts.append(("eval-combinations", design.train, True))
    for part, targets, held_out in parts:
        several = [(relation,) for relation in relations if len(relations) > 1]
        for asked in ((), *several) if held_out else several:
            name = "-".join((part, *(relation.lower().replace("_", "-") for relation in asked)))
            of = tuple(k for k in targets if design.relations_for(k, asked, held_out))
            if of:
                yield Condition(name, of, design.pool, design.n_blocks, relations=asked,
                                combinations=held_out)  # fmt: skip


def _comparing(design: Design) -> Iterator[Condition]:
    """Comparisons of places, and of sizes where they are drawn."""
    pool = design.pool
    cases: list[tuple[str, tuple[str, ...], Compared]]
    cases = [("compare", OF_PLACES, one) for one in COMPARED]
    if design.edges_m:
        cases += [("compare-size", OF_SIZES, one) for one in SIZES_COMPARED]
        targets, any_size = design.held_out or design.train, {SIZE: Term.ANY}
        # Of two blocks of a color and shape, the larger or the smaller one.
        yield Condition("compare-size", targets, pool, design.n_blocks, any_size,
                        compares=OF_SIZES, in_tables=False)  # fmt: skip
        # Sizes that training has not.
        unseen = design.unseen_edges_m
        yield Condition("eval-unseen", targets, pool, design.n_blocks, edges_m=unseen)
    # One of several blocks that one word, NOT or OR names.
    for start, comparisons, (end, count, named) in cases:
        targets = _named_by_one_of(design, named)
        if targets and count <= len(pool):
            edges = design.unseen_edges_m if end == "-unseen" else {}
            yield Condition(start + end, targets, pool, count, named=named, compares=comparisons,
                            edges_m=edges, in_tables=False)  # fmt: skip


def _named_by_one_of(design: Design, count: int) -> tuple[Kind, ...]:
    """The blocks that some expression of one word, NOT or OR names among `count` blocks."""
    nameable = {kind for _, named in expressions_for(design, count) for kind in named}
    return tuple(kind for kind in design.pool if kind in nameable)


def _distractors(
    condition: Condition,
    design: Design,
    unnamed: list[Kind],
    needed: list[Kind],
    rng: np.random.Generator,
) -> list[Kind]:
    """Draw the other blocks uniformly from the kinds that the program does not name."""
    rest = [kind for kind in unnamed if kind not in needed[1:]]
    chosen: list[Kind] = []
    count = min(condition.n_blocks - len(needed), len(rest))
    if condition.new_distractor and count > 0:
        new = [kind for kind in rest if kind not in design.pool]
        chosen.append(new[int(rng.integers(len(new)))])
        rest.remove(chosen[0])
    picks = rng.permutation(len(rest))[: max(count - len(chosen), 0)]
    return chosen + [rest[i] for i in picks]


def _spots(
    config: ArenaConfig, order: NDArray[np.intp], wanted: Wanted, rng: np.random.Generator
) -> list[Spot]:
    """Spots for the blocks, in their order."""
    for _ in range(PLACEMENT_TRIES):
        spots = spots_for(config, len(order), rng, wanted.apart_m)
        if wanted.within_m == inf:
            break
        (x, y), (u, v) = (spots[int(np.flatnonzero(order == i)[0])] for i in (0, 1))
        if hypot(x - u, y - v) <= wanted.within_m:
            break
    return spots
