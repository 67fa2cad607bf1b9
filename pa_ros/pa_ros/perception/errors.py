"""Errors of seeing."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class PerceptionError(PaError):
    """A picture or a calibration that cannot be used.

    Codes: "perception.picture", "perception.stamp", "perception.calibration", "perception.missing"
    (OpenCV).
    """

    code = "perception"
