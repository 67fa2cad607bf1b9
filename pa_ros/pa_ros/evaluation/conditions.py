"""The conditions under which agents are scored by their reward, in the order of the tables."""

from __future__ import annotations

from pa_ros.arena import Design, conditions_for

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
BY_SUCCESS = ("chain-", "compare", "avoid", "finite-")
"""Beginnings of the names of conditions that are scored by success."""


def conditions_of(design: Design) -> tuple[str, ...]:
    """All conditions of a design: those of CONDITIONS, then custom ones in the design's order.

    Chains, comparisons, and what is to be avoided are left out: they are scored by success. Where
    the hand is moved, numbers of blocks are only those of CONDITIONS.
    """
    known = conditions_for(design)
    skipped = BY_SUCCESS if design.vocabulary.moves_objects else (*BY_SUCCESS, "blocks-")
    ours = [name for name in CONDITIONS if name in (*known, RANDOM_WEIGHTS)]
    own = [name for name in known if name not in ours and not name.startswith(skipped)]
    return (*ours, *own)
