"""The conditions under which agents are scored by their reward, in the order of the tables."""

from __future__ import annotations

from pa_ros.arena import Design, condition_named, conditions_for

RANDOM_WEIGHTS = "random"
"""A condition on the episodes of `train`, for networks with random weights."""

CONDITIONS = (
    *("train", RANDOM_WEIGHTS, "eval", "only-color", "only-shape", "not-color", "not-shape"),
    *(f"blocks-{count}" for count in (2, 3, 5, 6, 8)),
    *("ignore-new", "reach-new-shape", "reach-new-color", "reach-new-both"),
    *(f"depth-{depth}" for depth in (3, 4, 5, 6)),
    *(f"several-{count}" for count in (1, 2, 3, "all")),
)
"""Those of the paper, in the order of its figure, then longer programs and several targets."""


def conditions_of(design: Design) -> tuple[str, ...]:
    """All conditions of a design: those of CONDITIONS, then custom ones in the design's order.

    Others are left out, such as chains, which are scored by success (`Condition.in_tables`).
    """
    known = conditions_for(design)
    ours = [name for name in CONDITIONS if name in (*known, RANDOM_WEIGHTS)]
    others = [condition_named(name, design) for name in known if name not in ours]
    own = [condition.name for condition in others if condition.in_tables]
    return (*ours, *own)
