"""Zones: programs that move the hand among small colored spheres in the air, and avoid some.

After FrankaZoneEnv of Jaxolotl (arXiv 2609.38065), whose figures are used and not its code: spheres
of 0.07 m, one of each color, at least 0.14 m apart, in a box before a Panda; a control period of
0.05 s, and at most 0.02 m along an axis in each. Zones have no body. Who extends the arena can copy
this file: it holds the arm, the preset, the objects, the skill and the designs.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import hypot

import numpy as np
from numpy.typing import NDArray

from pa_ros.arena.appearance import APPEARANCES, BLOCK_HALF_SIZE_M, Look
from pa_ros.arena.arms import ARMS
from pa_ros.arena.arms.chain import Chain
from pa_ros.arena.arms.panda import BASE, HAND, JOINTS, LINKS, PANDA
from pa_ros.arena.conditions import Condition
from pa_ros.arena.config import PRESET_VALUES, ArenaConfig, Joints
from pa_ros.arena.designs import Design, Kind, kinds, register
from pa_ros.arena.episodes import PLACEMENT_TRIES, Block, Episode
from pa_ros.arena.errors import ArenaError
from pa_ros.arena.kinematics import hand_controller
from pa_ros.arena.references import nearest_target
from pa_ros.arena.skills import SKILLS, SUCCESS, DemoProgram, Skill
from pa_ros.arena.task import ReachTask
from pa_ros.core.experience import Float32, Float64
from pa_ros.language import Goal, Program, Vocabulary, Word, parse_goal, stages
from pa_ros.language.ltl import goal_from_ltl
from pa_ros.world.schema import ObjectSchema, OneHot, PropertyGroup

RADIUS_M, APART_M = 0.07, 0.14  # of a zone; between two centers, and from a center to the hand
LOW_M, HIGH_M = np.array([0.25, -0.32, 0.02]), np.array([0.77, 0.32, 0.50])  # zones are inside
SCENES = 100  # layouts that are tried for one episode
START_RAD = np.array([0.6, 0.4, 0.2, 0.4, 0.2, 0.4, 0.2])  # of joints from their start, at most
# In training so many zones are this far from the hand, so that chance meets some.
NEAR, BESIDE_M = 3, (0.09, 0.20)

COLORS = {
    "RED": "0.85 0.15 0.15", "GREEN": "0.15 0.65 0.2", "BLUE": "0.15 0.3 0.85",
    "YELLOW": "0.95 0.85 0.1", "PURPLE": "0.55 0.2 0.75", "ORANGE": "1 0.5 0.05",
    "CYAN": "0.1 0.75 0.85", "PINK": "0.95 0.5 0.75", "LIME": "0.55 0.9 0.1",
    "TEAL": "0 0.5 0.5", "INDIGO": "0.3 0 0.5", "BROWN": "0.5 0.3 0.2",
    "GREY": "0.5 0.5 0.5", "GOLD": "0.8 0.65 0.1", "NAVY": "0 0 0.45", "MAROON": "0.5 0 0.1",
}  # fmt: skip
ALPHA = 0.35

# Jaxolotl's seven finite formulas (conf/formulas/franka_zone_env/finite.yaml), for any four zones.
LETTERS = ("RED", "GREEN", "YELLOW", "PURPLE")
FORMULAS = (
    "F (GREEN & (!RED U YELLOW)) & F PURPLE",
    "F RED & (!RED U (GREEN & F YELLOW))",
    "F (RED | GREEN) & F YELLOW & F PURPLE",
    "!(PURPLE | YELLOW) U (RED & F GREEN)",
    "!GREEN U ((RED | PURPLE) & (!GREEN U YELLOW))",
    "((GREEN | RED) => (!YELLOW U PURPLE)) U YELLOW",
    "F (GREEN & F YELLOW) & G !(RED | PURPLE)",
)
ONE, BESIDE = "F RED", "!GREEN U RED"
# RED and GREEN are equally far, YELLOW is nearer to RED. EITHER is the goal, BETTER_FIRST judged.
EITHER, BETTER_FIRST = "F ((RED | GREEN) & F YELLOW)", "!GREEN U (RED & F YELLOW)"
EQUAL_M, LONGER = 0.02, 1.5  # difference of the distances; how much longer the way by GREEN is
DRAWS = 40  # of letters for one scene

ARM = replace(
    PANDA,
    name="panda-wide",
    # All that the real joints allow, but for a margin: the working range is for blocks on a table.
    joints=(_JOINTS := tuple(
        replace(one, lower=one.limits[0] + 0.05, upper=one.limits[1] - 0.05)
        for one in JOINTS if one.limits
    )),
    mjcf=Chain(BASE, _JOINTS, LINKS, HAND),
    hand_radii_m=(0.25, 0.83),
    hand_heights_m=(0.03, 0.50),
)  # fmt: skip
ARMS.register(ARM.name, ARM)
PRESET_VALUES.register(
    "zones",
    ("fast", {"arm": ARM.name, "hand_speed": 0.4, "control_period_s": 0.05, "episode_steps": 50,
              "thresholds": (RADIUS_M,), "arm_touches_blocks": False}),
)  # fmt: skip


def _look(look: Look, color: str) -> Look:
    scale = RADIUS_M / BLOCK_HALF_SIZE_M
    return replace(look, shape="SPHERE", scale=scale, rgba=f"{COLORS[color]} {ALPHA}")


APPEARANCES.register("zone", _look)


@dataclass(frozen=True)
class FormulaEpisode(Episode):
    """An episode whose goal was made from a formula of temporal logic."""

    formula: str = ""


class FormulaSkill(Skill):
    """One whose episodes are FormulaEpisodes, so that `evaluation.traces` judges agents."""

    score = SUCCESS


class Zones(FormulaSkill):
    """Moves the hand to zones, and learns to stay away from others."""

    preset = "zones"
    does = "cannot push or grasp"
    demo_conditions = "train", "train"

    def training_programs(self, design: Design) -> tuple[Program, ...]:
        """Programs that reach each zone; then those that avoid one, but for held-out pairs."""
        words = [Word(str(kind)) for kind in design.train]
        held = held_out(len(words))
        reach = [Program(word) for word in words]
        avoid = [Program(one, avoided=other) for i, one in enumerate(words)
                 for j, other in enumerate(words) if i != j and not held[i, j]]  # fmt: skip
        return (*reach, *avoid)

    def conditions(self, design: Design) -> Iterator[Condition]:
        """The names say what is drawn: see `_formulas`."""
        numbered = [f"formula-{i}" for i in range(1, len(FORMULAS) + 1)]
        names = ("reach", "blocked", "blocked-pairs", "formulas", "formulas-blocked", "non-myopic",
                 *numbered)  # fmt: skip
        yield Condition("train", design.train, design.pool, design.n_blocks)
        for name in ("eval", *names, *(f"{one}-blocked" for one in numbered)):
            yield Condition(name, design.pool, design.pool, design.n_blocks, in_tables=False)

    def draw(
        self,
        config: ArenaConfig,
        design: Design,
        condition: Condition,
        index: int,
        rng: np.random.Generator,
    ) -> Episode:
        """A random scene, and if the condition says so one that fits the formula's letters."""
        formulas = _formulas(condition.name)
        formula = formulas[index % len(formulas)]
        for _ in range(PLACEMENT_TRIES):
            places, start, hand = _scene(config, design.n_blocks, rng, condition.name == "train")
            colors = [design.pool[i] for i in rng.permutation(len(design.pool))]
            for _ in range(DRAWS):
                letters = dict(zip(LETTERS, rng.permutation(len(colors)).tolist(), strict=False))
                if _fits(condition.name, formula, letters, colors, places, hand):
                    named = {letter: str(colors[i]) for letter, i in letters.items()}
                    goal = parse_goal(_named(str(_goal(formula)), named), design.vocabulary)
                    blocks = tuple(map(_zone, colors, *places.T.tolist()))
                    judged = BETTER_FIRST if formula == EITHER else formula
                    return FormulaEpisode(index, condition.name, blocks, start, goal,
                                   formula=_named(judged, named))  # fmt: skip
        raise ArenaError(f"condition {condition.name}: expected a scene that fits, found none in "
                         f"{PLACEMENT_TRIES}", code="arena.episode")  # fmt: skip

    def script(self, task: ReachTask) -> Float64:
        """Straight to the target, whatever is to be avoided: a reference that shows how much
        avoiding a condition asks for."""
        hand, to = task.simulation.positions[0], nearest_target(task)
        x, y = hand[:2] / max(hypot(*hand[:2]), 0.05)
        step_m = task.config.hand_speed * task.config.control_period_s
        east, north, up = (to - hand) / step_m
        action = np.array([x * east + y * north, x * north - y * east, up])
        action /= max(1.0, float(np.abs(action).max()))
        controller = hand_controller(task.config)
        moving: Float32 = controller.joint_action(
            action.astype(np.float32), task.simulation.joint_position
        )
        return moving * controller.speed_limits

    def demo(self, design: Design) -> list[DemoProgram]:
        one, two = map(str, design.train[:2])
        return [
            DemoProgram("trained", f"NEAR(HAND, {one})"),
            DemoProgram("AVOID", f"AVOID({one}, NEAR(HAND, {two}))"),
        ]


SKILLS.register("zones", Zones())


@lru_cache(maxsize=8)
def held_out(count: int) -> NDArray[np.bool_]:
    """Which pairs (reached, avoided) of so many zones no training program has, a quarter:
    [count, count]."""
    pairs = np.argwhere(~np.eye(count, dtype=bool))
    held = np.zeros((count, count), bool)
    held[tuple(np.random.default_rng(0).permutation(pairs)[: len(pairs) // 4].T)] = True
    return held


def _formulas(condition: str) -> tuple[str, ...]:
    """The formulas of a condition, one episode after the other."""
    if condition in ("train", "reach"):
        return (ONE, *(BESIDE,) * 4)[: 1 if condition == "reach" else 5]
    if condition.startswith(("blocked", "eval")):
        return (BESIDE,)
    if condition == "formulas-blocked":  # the others avoid nothing
        return tuple(one for one in FORMULAS if "!" in one)
    if condition == "non-myopic":
        return (EITHER,)
    name = condition.removesuffix("-blocked").removeprefix("formula-")
    return FORMULAS if name == "formulas" else (FORMULAS[int(name) - 1],)


def _named(text: str, words: Mapping[str, str]) -> str:
    """A formula or goal with other words in place of LETTERS."""
    return re.sub("|".join(LETTERS), lambda found: words[found[0]], text)


@lru_cache
def _goal(formula: str) -> Goal:
    return goal_from_ltl(formula, Vocabulary.of(zone=LETTERS))


def _fits(
    condition: str,
    formula: str,
    letters: Mapping[str, int],
    colors: Sequence[Kind],
    places: Float64,
    hand: Float64,
) -> bool:
    """Whether zones with these letters are as a condition's name says. Where the formula first
    avoids something, that is in the way, and a held-out pair or not."""
    if condition == "non-myopic":
        better, worse, last = places[[letters[one] for one in ("RED", "GREEN", "YELLOW")]]
        first, second = np.linalg.norm([better - hand, worse - hand], axis=-1)
        then, instead = np.linalg.norm([last - better, last - worse], axis=-1)
        clear = _beside(hand, better, worse[None])[0] > RADIUS_M
        equal, longer = abs(first - second) < EQUAL_M, second + instead > LONGER * (first + then)
        return bool(clear and equal and longer)
    here = hand
    for program in stages(_goal(formula)):
        among = [letters[word] for word in program.relation_alone.words]
        to = min(among, key=lambda i: float(np.linalg.norm(places[i] - here)))
        if program.avoided is None:
            here = places[to]
            continue
        out = [letters[word] for word in Program(program.avoided).words]
        numbers = [list(COLORS).index(str(colors[i])) for i in (to, out[0])]
        held = bool(held_out(len(colors))[*numbers])
        blocked = bool((_beside(here, places[to], places[out]) < RADIUS_M).any())
        if condition in ("train", "eval"):
            return held == (condition == "eval")
        if condition in ("blocked", "blocked-pairs") and held != (condition == "blocked-pairs"):
            return False
        return blocked or "blocked" not in condition
    return "blocked" not in condition


def _beside(start: Float64, end: Float64, places: Float64) -> Float64:
    """How near the straight way from start to end [3] comes to each place [n, 3]: [n], m."""
    way, to = end - start, places - start
    share = np.clip(to @ way / max(float(way @ way), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(to - share[:, None] * way, axis=-1))


def _scene(
    config: ArenaConfig, count: int, rng: np.random.Generator, training: bool
) -> tuple[Float64, Joints, Float64]:
    """Centers of zones [count, 3], in training NEAR of them beside the hand; joint positions, and
    where the hand then is [3]."""
    near, away = (NEAR, BESIDE_M[0]) if training else (0, APART_M)
    low, high, controller = LOW_M + RADIUS_M, HIGH_M - RADIUS_M, hand_controller(config)
    for _ in range(SCENES):
        turns = rng.uniform(-1.0, 1.0, len(START_RAD)) * START_RAD
        joints = tuple(one.start + turn for one, turn in zip(_JOINTS, turns, strict=True))
        hand = controller.hand(joints).place
        if (hand < low).any() or (hand > high).any():
            continue
        beside = rng.normal(size=(10 * near, 3))
        beside *= rng.uniform(*BESIDE_M, (len(beside), 1)) / np.linalg.norm(beside, axis=1)[:, None]
        anywhere = rng.uniform(low, high, (40 * count, 3))
        places = np.zeros((0, 3))
        for wanted, drawn in ((near, hand + beside), (count, anywhere)):
            drawn = drawn[((drawn >= low) & (drawn <= high)).all(-1)]
            for place in drawn[np.linalg.norm(drawn - hand, axis=-1) >= away]:
                if len(places) == wanted:
                    break
                if (((places - place) ** 2).sum(-1) >= APART_M**2).all():
                    places = np.vstack([places, place])
        if len(places) == count:
            return places, joints, hand
    raise ArenaError(
        f"{count} zones, {APART_M} m apart and from the hand, don't fit into the box "
        f"{LOW_M.tolist()} to {HIGH_M.tolist()} m",
        code="arena.episode",
    )


def _zone(kind: Kind, x: float, y: float, z: float) -> Block:
    """A zone with its center at a place."""
    on_table = Block(kind, x, y, 0.0)
    return replace(on_table, above_m=z - on_table.look.rest_height)


def _design(count: int) -> Design:
    words = tuple(COLORS)[:count]
    group = PropertyGroup("zone", words, OneHot(words), bodiless=words)
    vocabulary, values = Vocabulary.of(zone=words).avoiding(), {"zone": words}
    return Design(f"zones-{count}", values, vocabulary, kinds(values), n_blocks=count,
                  schema=ObjectSchema((group,)), skill_name="zones")  # fmt: skip


register(_design(8), _design(16))
