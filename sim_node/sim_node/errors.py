"""What an arena on the graph refuses."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class StaleCommandError(PaError):
    """A command for another step than the one that waits for an answer."""

    code = "command.stale"


class PausedError(PaError):
    """A command to an arena that is paused."""

    code = "arena.paused"


class InactiveError(PaError):
    """Anything that an arena is asked while it is not active."""

    code = "arena.inactive"


class NotPausedError(PaError):
    """Single steps are for a paused arena."""

    code = "arena.not_paused"


class LockstepError(PaError):
    """A speed for an arena that runs as fast as its commands come."""

    code = "arena.lockstep"


class SimulatorError(PaError):
    """A request to the simulator that it refuses; `result` is the standard's code of the cause."""

    code = "arena.request"

    def __init__(self, text: str, result: int) -> None:
        super().__init__(text)
        self.result = int(result)


class NoProgramError(PaError):
    """A command while no program is in force."""

    code = "arena.no_program"
