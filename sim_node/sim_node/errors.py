"""What an arena on the graph refuses."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class StaleCommandError(PaError):
    """A command for another step than the one that waits for an answer."""

    code = "command.stale"


class PausedError(PaError):
    """A command to an arena that is paused."""

    code = "arena.paused"


class NotPausedError(PaError):
    """Single steps are for a paused arena."""

    code = "arena.not_paused"


class LockstepError(PaError):
    """A speed for an arena that runs as fast as its commands come."""

    code = "arena.lockstep"


class NoProgramError(PaError):
    """A command while no program is in force."""

    code = "arena.no_program"
