"""NEAR: the paper's relation."""

from __future__ import annotations

import numpy as np

from pa_ros.core.experience import Float64
from pa_ros.world.relations.relation import Relation, circle, register

HOVER = 0.6  # where the script holds the hand above the target's center, as part of the threshold


def _distance(hand: Float64, objects: Float64) -> Float64:
    """From the hand, where positions in its own frame begin."""
    squares = objects[..., :3] * objects[..., :3]
    return np.asarray(np.sqrt(squares[..., 0] + squares[..., 1] + squares[..., 2]))


def _above_it(hand: Float64, target: Float64, threshold: float) -> Float64:
    """0.12 m above the target's center at a threshold of 0.20 m: clear of the block."""
    return np.asarray(target + np.array([0.0, 0.0, HOVER * threshold]))


def _around_the_hand(hand: Float64, target: Float64, threshold: float) -> Float64:
    return circle(hand, threshold)


NEAR = register(
    Relation(
        name="NEAR",
        meaning="no farther from its center than the threshold (paper, section 3)",
        measure=_distance,
        unit="m",
        threshold=0.20,
        goal=_above_it,
        outline=_around_the_hand,
        frame="hand",
    )
)
