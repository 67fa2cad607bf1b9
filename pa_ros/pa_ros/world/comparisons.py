"""Comparisons: which object of a set comes first by its place or its size. How it is compared is
given, and not learned; which objects are in the set is for the networks to say.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pa_ros.core.experience import Float32, Float64
from pa_ros.language.syntax import OF_SIZES, SIZE
from pa_ros.world.poses import POSE_WIDTH, in_base
from pa_ros.world.schema import ObjectSchema

SCORES: dict[str, Callable[[Float64], Float64]] = {
    "LEFTMOST": lambda place: place[..., 1],
    "RIGHTMOST": lambda place: -place[..., 1],
    "NEAREST": lambda place: -np.hypot(place[..., 0], place[..., 1]),
    "FARTHEST": lambda place: np.hypot(place[..., 0], place[..., 1]),
}
"""Of places [..., 3] (m) in the base's frame, whose x is before the arm and whose y is to its left:
the greatest score is chosen. Near and far are meant from the base."""


def choose(
    comparison: str,
    among: Sequence[int],
    objects: Float32,
    hand_pose: Float64,
    schema: ObjectSchema,
) -> tuple[int, ...]:
    """The chosen one of the objects `among` of a scene [N, F], all of them without a comparison.

    `hand_pose` [7] is in the base's frame. Sizes are the first feature of the group `SIZE`.
    """
    if not comparison or not among:
        return tuple(among)
    rows = objects[[*among]].astype(np.float64)
    if comparison in OF_SIZES:
        sizes = rows[:, schema.slices[SIZE].start]
        scores = sizes if comparison == OF_SIZES[0] else -sizes
    else:
        scores = SCORES[comparison](in_base(hand_pose, rows[:, :POSE_WIDTH])[..., :3])
    return (among[int(np.argmax(scores))],)
