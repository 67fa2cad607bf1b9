"""What an agent on the graph refuses."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class StaleObservationError(PaError):
    """An observation from before the one that was handled last."""

    code = "observation.stale"


class NoArenaError(PaError):
    """A step of an arena that has not described itself yet."""

    code = "observation.no_arena"


class RunError(PaError):
    """Weights older than the ones in use, of the same run."""

    code = "policy.stale"
