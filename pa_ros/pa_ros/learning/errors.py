"""Errors of the learning room; `code` says which kind each one is."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class LearningError(PaError):
    """A trajectory that cannot be learned from, or a learner that cannot do what was asked."""

    code = "learning.trajectory"


class CheckpointError(LearningError):
    """A checkpoint that is missing, damaged, or of other networks or settings; or a
    run's folder that another run uses (learning.in_use) or used (learning.folder_used)."""

    code = "learning.checkpoint"


class DivergedError(LearningError):
    """Learning whose numbers are not finite any more; none of them may be published or saved."""

    code = "learning.diverged"
    restored = False  # whether the learner is again as it was before
