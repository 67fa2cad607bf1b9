"""What an agent sees of objects whose poses somebody measures, a tag tracker say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pa_ros.core.experience import Float32, Float64
from pa_ros.world.schema import ObjectSchema


def objects_from_poses(
    schema: ObjectSchema, labels: Sequence[Mapping[str, str]], poses: Float64
) -> Float32:
    """Features of the hand and of n objects after it, [1 + n, F].

    `labels` have each object's value of each property group; `poses` [1 + n, 7], the hand's first,
    are positions (m) and unit quaternions xyzw in one frame, whichever: the features are in the
    hand's. Raises ConfigError for labels that the schema does not have.
    """
    hand = np.zeros(schema.width, np.float32)
    objects = np.stack([hand, *map(schema.features, labels)])
    back = poses[0, 3:] * (-1.0, -1.0, -1.0, 1.0)  # the hand's orientation undone
    away = np.concatenate([poses[:, :3] - poses[0, :3], np.zeros((len(poses), 1))], 1)
    objects[:, :3] = times(times(back, away), poses[0, 3:])[:, :3]
    turned = times(back, poses[:, 3:])
    objects[:, 3:7] = turned * np.copysign(1.0, turned[:, 3:])  # qw >= 0
    return objects


def times(a: Float64, b: Float64) -> Float64:
    """Products of quaternions xyzw, [..., 4]."""
    (ax, ay, az, aw), (bx, by, bz, bw) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    product = (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )
    return np.stack(product, -1)
