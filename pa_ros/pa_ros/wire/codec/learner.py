"""What a learner asks of its agents (LearnerInfo)."""

from __future__ import annotations

import math

import numpy as np

from pa_ros import __version__
from pa_ros.core.published import LearnerInfo
from pa_ros.wire import errors
from pa_ros.wire import interfaces as types
from pa_ros.wire.arrays import float64_field
from pa_ros.wire.codec.stamp import read_stamp, write_stamp
from pa_ros.wire.records import WIRE_VERSION

MAX_TRAJECTORY_STEPS = 10_000
_SAME = (
    *("run_id", "learner_id", "first_version", "world_digest", "architecture", "algorithm"),
    *("trajectory_steps", "policy_lag", "exploration", "inference", "software_version"),
    *("control_period", "reward"),
)


def encode_learner_info(learner: LearnerInfo) -> types.LearnerInfo:
    """The latched announcement of a learner."""
    message = types.LearnerInfo()
    write_stamp(message.stamp, learner.stamp_ns)
    for name in _SAME:
        setattr(message, name, getattr(learner, name))
    message.thresholds = float64_field(np.asarray(learner.thresholds))
    message.software_version = learner.software_version or __version__
    message.wire_version = WIRE_VERSION
    return message


def decode_learner_info(message: types.LearnerInfo) -> LearnerInfo:
    """Raises VersionError, RangeError."""
    if message.wire_version != WIRE_VERSION:
        raise errors.VersionError("learner_info.wire_version", WIRE_VERSION, message.wire_version)
    for name in ("run_id", "learner_id"):
        if not getattr(message, name):
            raise errors.RangeError(f"learner_info.{name}", "a name", "''")
    if not 1 <= message.trajectory_steps <= MAX_TRAJECTORY_STEPS:
        expected = f"1 to {MAX_TRAJECTORY_STEPS}"
        raise errors.RangeError("learner_info.trajectory_steps", expected, message.trajectory_steps)
    positive = {"control_period": (message.control_period,), "thresholds": message.thresholds}
    for name, value in ((name, one) for name, several in positive.items() for one in several):
        if not 0.0 < value < math.inf:
            raise errors.RangeError(f"learner_info.{name}", "a positive number", value)
    values = {name: getattr(message, name) for name in _SAME}
    thresholds = tuple(message.thresholds)
    return LearnerInfo(**values, thresholds=thresholds, stamp_ns=read_stamp(message.stamp))
