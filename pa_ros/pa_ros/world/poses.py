"""Poses x y z (m), quaternion xyzw: changes of frame, and object features from measured poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pa_ros.core.experience import Float32, Float64
from pa_ros.world.schema import ObjectSchema

POSE_WIDTH = 7
IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def in_base(hand: Float64, poses: Float64) -> Float64:
    """Poses [..., 7] in the base's frame, from poses in the hand's frame and the hand's pose.

    Written by components, because that gives the same bits for one pose as for many, and is fast
    for one.
    """
    hx, hy, hz, a, b, c, w = (hand[..., i] for i in range(POSE_WIDTH))
    x, y, z, i, j, k, r = (poses[..., n] for n in range(POSE_WIDTH))
    u, v, t = 2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)  # twice a cross product
    result = np.empty(np.broadcast_shapes((*hand.shape[:-1], POSE_WIDTH), poses.shape))
    result[..., 0] = hx + x + w * u + b * t - c * v
    result[..., 1] = hy + y + w * v + c * u - a * t
    result[..., 2] = hz + z + w * t + a * v - b * u
    result[..., 3] = w * i + a * r + b * k - c * j
    result[..., 4] = w * j + b * r + c * i - a * k
    result[..., 5] = w * k + c * r + a * j - b * i
    result[..., 6] = w * r - a * i - b * j - c * k
    return result


def places(hand: Float64, objects: Float32) -> Float64:
    """Where objects are, [N, 3] m in the base's frame, from the hand's pose [7] and their features
    [N, F]."""
    return in_base(hand, objects[:, :POSE_WIDTH].astype(np.float64))[:, :3]


def in_hand(hand: Float64, poses: Float64) -> Float64:
    """The inverse of `in_base`: poses [..., 7] in the frame of the hand, with qw >= 0."""
    hx, hy, hz, a, b, c, w = (hand[..., i] for i in range(POSE_WIDTH))
    x, y, z = poses[..., 0] - hx, poses[..., 1] - hy, poses[..., 2] - hz
    # The inverse of the hand's orientation, times x y z.
    i, j, k = w * x - b * z + c * y, w * y + a * z - c * x, w * z - a * y + b * x
    r = a * x + b * y + c * z
    result = np.empty(np.broadcast_shapes((*hand.shape[:-1], POSE_WIDTH), poses.shape))
    result[..., 0] = r * a + i * w + j * c - k * b
    result[..., 1] = r * b - i * c + j * w + k * a
    result[..., 2] = r * c + i * b - j * a + k * w
    turned = times(hand[..., 3:POSE_WIDTH] * (-1.0, -1.0, -1.0, 1.0), poses[..., 3:])
    result[..., 3:] = turned * np.copysign(1.0, turned[..., 3:])
    return result


def objects_from_poses(
    schema: ObjectSchema, labels: Sequence[Mapping[str, str]], poses: Float64
) -> Float32:
    """Features of the hand and of n objects after it, [1 + n, F], from measured poses.

    `labels` contain the value of each property group for each object. `poses` [1 + n, 7], the
    hand's first, are in any one frame; the features are in the frame of the hand. Raises
    ConfigError for labels that the schema does not contain.
    """
    hand = np.zeros(schema.width, np.float32)
    objects = np.stack([hand, *map(schema.features, labels)])
    objects[:, :POSE_WIDTH] = in_hand(poses[0], poses)
    return objects


def times(a: Float64, b: Float64) -> Float64:
    """Products of quaternions xyzw, [..., 4]."""
    ax, ay, az, aw = (a[..., i] for i in range(4))
    bx, by, bz, bw = (b[..., i] for i in range(4))
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = aw * bx + ax * bw + ay * bz - az * by
    product[..., 1] = aw * by - ax * bz + ay * bw + az * bx
    product[..., 2] = aw * bz + ax * by - ay * bx + az * bw
    product[..., 3] = aw * bw - ax * bx - ay * by - az * bz
    return product
