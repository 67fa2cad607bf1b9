"""What an agent on the graph refuses."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class StaleObservationError(PaError):
    """An observation from before the one that was handled last."""

    code = "observation.stale"
