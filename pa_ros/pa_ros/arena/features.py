"""Ω from poses: what the agent sees of the objects, in the frame of the hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pa_ros.arena.designs import Kind
from pa_ros.core.experience import Float32, Float64
from pa_ros.world.schema import ObjectSchema

HAND_INDEX = 0
# conj(h) b as a product with a matrix made of h: entry [in wxyz, out xyzw] is SIGN · h[ENTRY].
_ENTRY = np.array([[1, 2, 3, 0], [0, 3, 2, 1], [3, 0, 1, 2], [2, 1, 0, 3]])
_SIGN = np.array(
    [[-1.0, -1.0, -1.0, 1.0], [1.0, -1.0, 1.0, 1.0], [1.0, 1.0, -1.0, 1.0], [-1.0, 1.0, 1.0, 1.0]]
)


def template(schema: ObjectSchema, kinds: Sequence[Kind]) -> Float32:
    """What doesn't change within an episode: properties, and the hand's own row; [1 + n, F]."""
    hand = np.zeros(schema.width, dtype=np.float32)
    hand[6] = 1.0  # identity quaternion
    return np.stack([hand, *map(schema.features, kinds)])


def object_features(
    rows: Float32, position: Float64, quaternion: Float64, rotation: Float64
) -> Float32:
    """Fill in the poses: `ObjectSchema.feature_names`, [1 + n, F], a new array.

    `rows` is the template; `position` [1 + n, 3] (m) and `quaternion` [1 + n, 4] (wxyz) are those
    of hand and blocks in the table's frame; `rotation` [9] is the hand's matrix, row by row.
    """
    objects = rows.copy()
    objects[1:, :3] = (position[1:] - position[0]) @ rotation.reshape(3, 3)
    relative = quaternion[1:] @ (quaternion[0][_ENTRY] * _SIGN)  # [n, 4] xyzw
    objects[1:, 3:7] = relative * np.copysign(1.0, relative[:, 3:])  # qw >= 0
    return objects
