"""Pushing: programs that move a block to a place or to another block, besides those that reach."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations, product
from math import atan2, cos, hypot, pi, sin
from typing import Any

import numpy as np

from pa_ros.arena.arms import ARMS
from pa_ros.arena.conditions import Condition, Term
from pa_ros.arena.config import ArenaConfig
from pa_ros.arena.designs import Design, Kind, kinds
from pa_ros.arena.drawn_programs import DeepPrograms, terms_for
from pa_ros.arena.episodes import PLACEMENT_TRIES, Block, Episode, Spot, spots_for
from pa_ros.arena.errors import ArenaError
from pa_ros.arena.kinematics import joints_at
from pa_ros.arena.references import nearest_pair, push, reach
from pa_ros.arena.simulation import HAND_INDEX
from pa_ros.arena.skills import SKILLS, SUCCESS, DemoProgram, Skill, two_alike
from pa_ros.arena.task import ReachTask
from pa_ros.core.experience import Float64
from pa_ros.language import HAND, Program, parse, roles, satisfying
from pa_ros.world.relation import RELATIONS

NEAR_STARTS = 0.5  # in training: then random actions push the block, and learning can begin

# Episodes. Lengths in m.
MOVE_M = (0.12, 0.40)  # from the block to the place that it is to be moved to
MOVE_TO_BLOCK_M = (0.20, 0.45)  # to another block
PAIRS = 4  # least number of pairs of objects that are so far apart
NEAR_HAND_M = (0.11, 0.22)  # from the moved block to the hand, if it starts beside it
NEAR_HAND_HEIGHT_M = 0.085  # low enough to push
HAND_GAP_M = 0.10  # between the hand and every block
PLACE_GAP_M = 0.12  # between a place and every block, so that no block is near it at the start
PLACES_APART_M = 0.16
SPOT_TRIES = 200

# Programs to show.
FARTHEST_M = 0.40  # that a block is moved
LONGEST = 99  # steps of a program


class Pushing(Skill):
    """Moves blocks to places and to other blocks, and the hand to both."""

    preset = "push"
    touches_blocks = True
    does = "pushes blocks; it cannot grasp"
    score = SUCCESS
    demo_conditions = "eval", "moved-only-color"

    def training_programs(self, design: Design) -> tuple[Program, ...]:
        """Programs that move each training block to each place (and to each other training block),
        then those that reach for each block and place."""
        moves = [(kind.conjunction, to) for kind, to in product(design.train, _destinations(design))
                 if kind != to]  # fmt: skip
        reaches = [(HAND.name, kind) for kind in (*design.train, *design.places)]
        return tuple(
            parse(f"{relation}({moved}, {target.conjunction})", design.vocabulary)
            for relation in design.vocabulary.relations
            for moved, target in (*moves, *reaches)
            if self.takes(relation, moved == HAND.name, target)
        )

    def takes(self, relation: str, of_hand: bool, target: Kind) -> bool:
        """Whether programs relate the hand, or an object, to such a target by a relation."""
        return True

    def conditions(self, design: Design) -> Iterator[Condition]:
        """Programs move blocks to places, except in `pairs…` and `reach…`."""
        pool, places, n = design.pool, design.places, design.n_blocks
        zero_shot = design.held_out or design.train

        def condition(name: str, targets: Sequence[Kind] = places, **changed: Any) -> Condition:
            return Condition(name, tuple(targets), **{"pool": pool, "n_blocks": n, **changed})

        # A training block; in half of the episodes the hand starts beside it.
        yield condition("train", _destinations(design), moved=design.train, near_starts=NEAR_STARTS)
        # A held-out block.
        yield condition("eval", moved=zero_shot)
        # Any, a training, a held-out block, to another block.
        yield condition("pairs", pool, moved=pool)
        yield condition("pairs-train", design.train, moved=design.train)
        yield condition("pairs-eval", pool, moved=zero_shot)
        # The hand, to a training block or a place; to a held-out block.
        yield condition("reach", (*design.train, *places))
        yield condition("reach-eval", zero_shot)
        # Any block, where one argument is an OR of two; where a random program names the block.
        yield condition("moved-or", moved=pool, either=("moved",))
        yield condition("target-or", moved=pool, either=("target",))
        yield condition("depth-3", moved=pool, depth=3)
        # Any block, to a place or block that is named in another way.
        yield condition("target-only-shape", moved=pool, terms={"color": Term.ANY})
        yield condition("target-only-color", pool, moved=pool, terms={"shape": Term.ANY})
        yield condition("target-not-color", moved=pool, terms={"color": Term.NOT_ANOTHER})
        yield condition("target-not-shape", pool, moved=pool, terms={"shape": Term.NOT_ANOTHER})
        for group in design.values:
            # Any block, which is named in another way.
            others = {other: Term.ANY for other in design.values if other != group}
            yield condition(f"moved-only-{group}", moved=pool, moved_terms=others)
            negated = {group: Term.NOT_ANOTHER}
            yield condition(f"moved-not-{group}", moved=pool, moved_terms=negated)
            # A block with a new property; a training block to such a one.
            if design.spare(group) and group in design.novel:
                new = kinds({**design.values, group: (design.novel[group],)})
                wide, terms = design.extended_pool, {group: Term.NOVEL}
                yield condition(f"moved-new-{group}", moved=new, moved_terms=terms, pool=wide)
                yield condition(
                    f"target-new-{group}", new, moved=design.train, terms=terms, pool=wide
                )
        # A held-out block among others: from one block less than in training up to six blocks.
        for count in range(max(n - 1, 2), min(6, len(pool)) + 1):
            yield condition(f"blocks-{count}", moved=zero_shot, n_blocks=count)
        # As train, eval and pairs, of one of several relations.
        relations, known = design.vocabulary.relations, design.train[0]
        moving = [one for one in relations if self.takes(one, of_hand=False, target=known)]
        if len(moving) > 1:
            for relation in moving:
                name, only = relation.lower().replace("_", "-"), (relation,)
                yield condition(f"train-{name}", moved=design.train, relations=only)
                yield condition(f"eval-{name}", moved=zero_shot, relations=only)
                yield condition(f"pairs-{name}", pool, moved=pool, relations=only)

    def draw(
        self,
        config: ArenaConfig,
        design: Design,
        condition: Condition,
        index: int,
        rng: np.random.Generator,
    ) -> Episode:
        """Blocks come first, then places."""
        base = float(rng.uniform(config.joint_lower[0], config.joint_upper[0]))
        moved = _one_of(condition.moved, rng) if condition.moved else None
        target = _one_of([kind for kind in condition.targets if condition.tells(kind, moved)], rng)
        relations = condition.relations or design.vocabulary.relations
        fitting = [one for one in relations if self.takes(one, moved is None, target)]
        program, required = _program(condition, design, fitting, moved, target, rng)
        named = [*([] if moved is None else [moved]), target, *required]
        blocks = list(dict.fromkeys(kind for kind in named if design.schema.has_body(kind)))
        places = list(dict.fromkeys(kind for kind in named if not design.schema.has_body(kind)))
        for chosen, pool, count in (
            (blocks, condition.pool, condition.n_blocks),
            (places, design.places, design.n_places),
        ):
            words = [kind.words for kind in pool]
            taken = satisfying(program, words, None, design.vocabulary.bodiless)
            free = [kind for kind, is_named in zip(pool, taken, strict=True) if not is_named]
            free = [free[i] for i in rng.permutation(len(free)) if free[i] not in chosen]
            chosen.extend(free[: max(count - len(chosen), 0)])
        to_place = target in design.places
        counts = len(blocks), len(places)
        for _ in range(PLACEMENT_TRIES):
            block_spots, place_spots = _layout(config, *counts, moved is not None, to_place, rng)
            spots = [*block_spots, *place_spots]
            if moved is None or not _holds(design, program, [*blocks, *places], spots):
                break
        start = base, *(joint.start for joint in ARMS[config.arm].joints[1:])
        if moved is not None and rng.random() < condition.near_starts:
            spot = _near(config, block_spots[0], NEAR_HAND_M, block_spots, HAND_GAP_M, rng)
            if spot is not None:
                start = joints_at(config, *spot, NEAR_HAND_HEIGHT_M)
        objects = [
            Block(chosen[i], spots[i][0], spots[i][1], float(rng.uniform(-pi, pi)))
            for chosen, spots in ((blocks, block_spots), (places, place_spots))
            for i in rng.permutation(len(chosen))
        ]
        return Episode(index, condition.name, tuple(objects), start, program)

    def script(self, task: ReachTask) -> Float64:
        return self.relate(task, *nearest_pair(task))

    def relate(self, task: ReachTask, moved: int, target: int) -> Float64:
        """The command that relates one object, or the hand, to another as the program says."""
        if moved == HAND_INDEX:
            return reach(task, task.simulation.positions[target])
        return push(task, moved, target)

    def demo(self, design: Design) -> list[DemoProgram]:
        """Programs that move blocks, and one that reaches."""
        first, last = [*design.values][0], [*design.values][-1]
        stay = [kind for kind in design.train if "SPHERE" not in kind.words]  # spheres roll past
        (known, other), new, places = two_alike(stay, last), design.held_out[0], design.places
        trained, held_out, here = known.conjunction, new.conjunction, places[0].conjunction
        without = f"AND(NOT({known[first]}), {', '.join([*other.values()][1:])})"
        relation = design.vocabulary.relations[0]
        moves = (
            ("trained", trained, places[-1].conjunction),
            ("held out", held_out, here),
            ("to a block", trained, held_out),
            (f"{first} alone", new[first], here),
            ("NOT", without, here),
        )
        return [
            *(
                DemoProgram(kind, f"{relation}({moved}, {target})", 2, FARTHEST_M, LONGEST)
                for kind, moved, target in moves
            ),
            DemoProgram("reach", f"{relation}(HAND, {held_out})"),
        ]


SKILLS.register("push", Pushing())


def _destinations(design: Design) -> tuple[Kind, ...]:
    """The targets to which training programs move blocks."""
    return (*design.places, *(design.train if design.pairs else ()))


def _program(
    condition: Condition,
    design: Design,
    relations: Sequence[str],
    moved: Kind | None,
    target: Kind,
    rng: np.random.Generator,
) -> tuple[Program, tuple[Kind, ...]]:
    """A program that relates a block, or the hand, to a target, and the objects that it needs
    besides them."""
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
        words, required = terms_for(design, kind, terms, rng)
        needed.extend(required)
        return words[0] if len(words) == 1 else f"AND({', '.join(words)})"

    first = HAND.name
    if moved is not None:
        first = argument(moved, "moved", condition.moved_terms, condition.pool)
    others = condition.pool if design.schema.has_body(target) else design.places
    second = argument(target, "target", condition.terms, others)
    return parse(f"{relation}({first}, {second})", design.vocabulary), tuple(needed)


def _one_of(choices: Sequence[Kind], rng: np.random.Generator) -> Kind:
    return choices[int(rng.integers(len(choices)))]


def _holds(design: Design, program: Program, kinds: Sequence[Kind], spots: Sequence[Spot]) -> bool:
    """Whether a program is satisfied by objects that lie at these spots."""
    relation = RELATIONS[program.relation]
    moved, named = roles(program, [kind.words for kind in kinds], None, design.vocabulary.bodiless)
    lying = np.array([(*spot, 0.0) for spot in spots])
    least = relation.between or relation.threshold
    return any(
        relation.of_places(lying[i], lying[j]) <= least
        for i, j in permutations(range(len(kinds)), 2)
        if moved[i] and named[j]
    )


def _layout(
    config: ArenaConfig,
    blocks: int,
    places: int,
    moves_block: bool,
    to_place: bool,
    rng: np.random.Generator,
) -> tuple[list[Spot], list[Spot]]:
    """Spots of blocks and places. The moved block is the first one; its target is the first place,
    or the second block.

    The spots are drawn without the program, and several pairs of them fit it, of which it takes
    any. So the scene says little about which objects the program names.
    """
    low, high = MOVE_M if to_place else MOVE_TO_BLOCK_M
    for _ in range(PLACEMENT_TRIES):
        spots, chosen = spots_for(config, blocks, rng), list[Spot]()
        while len(chosen) < places:
            spot = _near(config, spots[0], None, spots, PLACE_GAP_M, rng, chosen)
            if spot is None:
                break
            chosen.append(spot)
        if len(chosen) < places:
            continue
        if not moves_block:
            return spots, chosen
        targets = chosen if to_place else spots
        pairs = [
            (i, j)
            for i, spot in enumerate(spots)
            for j, target in enumerate(targets)
            if low <= _apart(spot, target) <= high
        ]
        if len(pairs) < min(PAIRS, blocks * len(targets) // 2):
            continue
        i, j = pairs[int(rng.integers(len(pairs)))]
        first, second = spots[i], targets[j]
        rest = [spot for spot in spots if spot not in (first, second)]
        if to_place:
            return [first, *rest], [second, *(spot for spot in chosen if spot != second)]
        return [first, second, *rest], chosen
    raise ArenaError(
        f"{blocks} blocks and {places} places don't fit on the table", code="arena.episode"
    )


def _near(
    config: ArenaConfig,
    spot: Spot,
    distances: tuple[float, float] | None,
    blocks: Sequence[Spot],
    gap: float,
    rng: np.random.Generator,
    places: Sequence[Spot] = (),
) -> Spot | None:
    """A random spot in the arm's reach, whose distance from `spot` is in `distances` (None: any),
    away from blocks and places; None if no try succeeded."""
    arm = ARMS[config.arm]
    (low, high), (first, last) = arm.block_radii_m, arm.block_angles
    for _ in range(SPOT_TRIES):
        if distances is None:
            distance, angle = rng.uniform(low**2, high**2) ** 0.5, rng.uniform(first, last)
            x, y = distance * cos(angle), distance * sin(angle)
        else:
            distance, angle = rng.uniform(*distances), rng.uniform(-pi, pi)
            x, y = spot[0] + distance * cos(angle), spot[1] + distance * sin(angle)
        found = float(x), float(y)
        reached = low <= hypot(x, y) <= high and first <= atan2(y, x) <= last
        free = all(_apart(found, block) >= gap for block in blocks)
        if reached and free and all(_apart(found, place) >= PLACES_APART_M for place in places):
            return found
    return None


def _apart(one: Spot, other: Spot) -> float:
    return hypot(one[0] - other[0], one[1] - other[1])
