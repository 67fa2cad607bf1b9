"""Poses x y z (m), quaternion xyzw: from the frame of the hand to that of the base."""

from __future__ import annotations

import numpy as np

from pa_ros.core.experience import Float64

POSE = 7  # features of one
IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def in_base(hand: Float64, poses: Float64) -> Float64:
    """Poses [..., 7] of the hand's frame in that of the base, given the hand's there, [..., 7].

    Written out by components: the same bits for one pose as for many, and soon done for one.
    """
    hx, hy, hz, a, b, c, w = (hand[..., i] for i in range(POSE))
    x, y, z, i, j, k, r = (poses[..., n] for n in range(POSE))
    u, v, t = 2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)  # twice a cross product
    result = np.empty(np.broadcast_shapes(hand.shape, poses.shape))
    result[..., 0] = hx + x + w * u + b * t - c * v
    result[..., 1] = hy + y + w * v + c * u - a * t
    result[..., 2] = hz + z + w * t + a * v - b * u
    result[..., 3] = w * i + a * r + b * k - c * j
    result[..., 4] = w * j + b * r + c * i - a * k
    result[..., 5] = w * k + c * r + a * j - b * i
    result[..., 6] = w * r - a * i - b * j - c * k
    return result
