"""What the acting room refuses, and why."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class StepError(PaError):
    """An observation, verdict or action that does not belong to the step it came with."""

    code = "learning.step"


class PolicyError(PaError):
    """Weights that this actor cannot use: another architecture, vocabulary or shape."""

    code = "learning.policy"


class LearnerRequestError(PaError):
    """A learner that asks of its agents what this one cannot do, or is not one for its arena."""

    code = "learner.request"
