"""Commands as the controllers of ros2_control take them."""

from __future__ import annotations

from collections.abc import Sequence

from pa_ros.core.experience import Float64
from pa_ros.wire.codec.stamp import write_stamp
from pa_ros.wire.interfaces import Float64MultiArray, JointTrajectory, JointTrajectoryPoint


def encode_velocities(velocity: Float64) -> Float64MultiArray:
    """Joint velocities, rad/s [J], in the order of the arena's joints."""
    return Float64MultiArray(data=velocity.tolist())


def encode_point(
    names: Sequence[str], position: Float64, velocity: Float64, after_s: float
) -> JointTrajectory:
    """One point, rad and rad/s [J], to be reached after so long."""
    point = JointTrajectoryPoint(positions=position.tolist(), velocities=velocity.tolist())
    write_stamp(point.time_from_start, round(after_s * 1e9))
    return JointTrajectory(joint_names=list(names), points=[point])
