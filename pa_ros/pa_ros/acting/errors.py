"""Errors of the acting room; `code` says which kind each one is."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class ActingError(PaError):
    """A step, weights or a learner's request that this agent cannot act on."""

    code = "learning.policy"
