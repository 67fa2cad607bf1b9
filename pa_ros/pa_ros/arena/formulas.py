"""The eight finite formulas by which GenZ-LTL is evaluated (Guo et al. 2025, its code's
`eval_test_tasks_finite.py`), as goals over time.

Its zones blue, green, yellow and magenta are four blocks here, b, g, y and m. Each goal implies its
formula, but not the other way round: `THEN` commits to the first state in which a part holds, where
`F (x & …)` may wait for a later one; the state that ends `!x U y` must itself be free of x; and an
implication cannot be said.
"""

from __future__ import annotations

from collections.abc import Mapping

from pa_ros.arena.designs import Kind
from pa_ros.language import Goal, Vocabulary, parse_goal

ZONES = ("b", "g", "y", "m")
ZONES_APART_M = 0.40  # twice the threshold of NEAR: zones do not overlap

B, G, Y, M = (f"NEAR(HAND, {{{zone}}})" for zone in ZONES)
B_OR_M, B_OR_G = (f"NEAR(HAND, OR({{b}}, {{{zone}}}))" for zone in "mg")

FORMULAS: Mapping[str, tuple[str, str]] = {
    "finite-1": (
        "F b & (!b U (g & F y))",
        f"THEN(AVOID({{b}}, {G}), ALL({Y}, {B}))",
    ),
    "finite-2": (
        "!(m|y) U (b & F g)",
        f"THEN(AVOID(OR({{m}}, {{y}}), {B}), {G})",
    ),
    "finite-3": (
        "!g U ((b|m) & (!g U y))",
        f"THEN(AVOID({{g}}, {B_OR_M}), AVOID({{g}}, {Y}))",
    ),
    # If the hand never comes near g and b, the implication holds: a stronger goal.
    "finite-4": (
        "((g|b) => (!y U m)) U y",
        f"AVOID(OR({{g}}, {{b}}), {Y})",
    ),
    # F (!g U y) is F y.
    "finite-5": (
        "F (g & (!(b|y) U (m & (!y U b)))) & F (!g U y)",
        f"ALL(THEN({G}, AVOID(OR({{b}}, {{y}}), {M}), AVOID({{y}}, {B})), {Y})",
    ),
    "finite-6": (
        "F ((b|g) & (!y U (b & (!g U m)))) & F (y & (!b U g))",
        f"ALL(THEN({B_OR_G}, AVOID({{y}}, {B}), AVOID({{g}}, {M})), THEN({Y}, AVOID({{b}}, {G})))",
    ),
    "finite-7": (
        "!(m|y) U (b & (!g U (y & F (g & (!b U m)))))",
        f"THEN(AVOID(OR({{m}}, {{y}}), {B}), AVOID({{g}}, {Y}), {G}, AVOID({{b}}, {M}))",
    ),
    "finite-8": (
        "F (b & (!y U (g & F (y & (!(m|g) U b)))))",
        f"THEN({B}, AVOID({{y}}, {G}), {Y}, AVOID(OR({{m}}, {{g}}), {B}))",
    ),
}
"""By condition: the formula, and the goal with a gap for each zone."""


def goal_of(condition: str, zones: Mapping[str, Kind], vocabulary: Vocabulary) -> Goal:
    """The goal of a condition for these blocks."""
    _, goal = FORMULAS[condition]
    words = {zone: kind.conjunction for zone, kind in zones.items()}
    return parse_goal(goal.format_map(words), vocabulary)
