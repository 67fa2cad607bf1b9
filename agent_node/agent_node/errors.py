"""What an agent on the graph refuses."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class StaleObservationError(PaError):
    """An observation from before the one that was handled last."""

    code = "observation.stale"


class GoalError(PaError):
    """A goal that can't be pursued now: no arena, or no weights."""

    code = "goal.unready"


class InactiveError(GoalError):
    """The agent is not active, or ceases to be."""

    code = "goal.inactive"


class ArenaGoneError(GoalError):
    """No arena is there any more that could say whether a goal is reached."""

    code = "goal.arena_gone"
