"""Where a body is, and how it moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pa_ros.core.experience import Float64


@dataclass(frozen=True)
class Body:
    """A body in the frame of the arm's base, on the table."""

    position: Float64  # [3] m
    quaternion: Float64  # [4] xyzw
    linear: Float64  # [3] m/s
    angular: Float64  # [3] rad/s, about that frame's axes

    @classmethod
    def at_rest(cls, position: Float64, quaternion: Float64) -> Body:
        """A body that doesn't move."""
        return cls(position, quaternion, np.zeros(3), np.zeros(3))
