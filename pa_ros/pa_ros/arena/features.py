"""Ω from poses: what the agent sees of the objects, in the frame of the hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pa_ros.arena.designs import Kind
from pa_ros.core.experience import COLORS, OBJECT_FEATURES, SHAPES, Float32, Float64

HAND_INDEX = 0
# conj(h) b as a product with a matrix made of h: entry [in wxyz, out xyzw] is SIGN · h[ENTRY].
_ENTRY = np.array([[1, 2, 3, 0], [0, 3, 2, 1], [3, 0, 1, 2], [2, 1, 0, 3]])
_SIGN = np.array(
    [[-1.0, -1.0, -1.0, 1.0], [1.0, -1.0, 1.0, 1.0], [1.0, 1.0, -1.0, 1.0], [-1.0, 1.0, 1.0, 1.0]]
)


def template(kinds: Sequence[Kind]) -> Float32:
    """What doesn't change within an episode: one-hots, and the hand's own row; [1 + n, 16]."""
    rows = np.zeros((1 + len(kinds), OBJECT_FEATURES), dtype=np.float32)
    rows[HAND_INDEX, 6] = 1.0  # identity quaternion
    for row, kind in zip(rows[1:], kinds, strict=True):
        row[7 + SHAPES.index(kind.shape)] = 1.0
        row[7 + len(SHAPES) + COLORS.index(kind.color)] = 1.0
    return rows


def object_features(
    rows: Float32, position: Float64, quaternion: Float64, rotation: Float64
) -> Float32:
    """Fill in the poses: `core.experience.OBJECT_FEATURE_NAMES`, [1 + n, 16], a new array.

    `rows` is the template; `position` [1 + n, 3] (m) and `quaternion` [1 + n, 4] (wxyz) are those
    of hand and blocks in the table's frame; `rotation` [9] is the hand's matrix, row by row.
    """
    objects = rows.copy()
    objects[1:, :3] = (position[1:] - position[0]) @ rotation.reshape(3, 3)
    relative = quaternion[1:] @ (quaternion[0][_ENTRY] * _SIGN)  # [n, 4] xyzw
    objects[1:, 3:7] = relative * np.copysign(1.0, relative[:, 3:])  # qw >= 0
    return objects
