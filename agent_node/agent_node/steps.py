"""The messages of one control step find each other by their stamp, which no other step has."""

from __future__ import annotations

from collections.abc import Iterable

from agent_node.errors import StaleObservationError
from pa_ros.wire import Message

KEPT = 8  # incomplete steps; in lockstep there are two at most


class StepMatcher:
    """Collects the parts of steps; a step is handed out once it is whole, in the order of time."""

    def __init__(self, parts: Iterable[str]) -> None:
        self._parts = frozenset(parts)
        self._partial: dict[int, dict[str, Message]] = {}
        self._newest = -1  # stamp of the newest step handed out

    def add(self, part: str, stamp_ns: int, message: Message) -> dict[str, Message] | None:
        """Take a message; the whole step's messages by part, if it was the last that lacked.

        Raises StaleObservationError for a step older than one handed out. The newest one itself
        may come again: an arena that got no answer repeats its step.
        """
        if stamp_ns < self._newest:
            raise StaleObservationError(
                f"{part}: expected a stamp of at least {self._newest} ns, got {stamp_ns}"
            )
        step = self._partial.setdefault(stamp_ns, {})
        step[part] = message
        if len(step) < len(self._parts):
            if len(self._partial) > KEPT:
                del self._partial[min(self._partial)]
            return None
        self._newest = stamp_ns
        self._partial = {k: v for k, v in self._partial.items() if k > stamp_ns}
        return step

    @property
    def lacking(self) -> list[str]:
        """Parts that the newest incomplete step waits for; none if there is no such step."""
        newest = self._partial[max(self._partial)] if self._partial else self._parts
        return sorted(self._parts.difference(newest))

    def restart(self) -> None:
        """Another arena's clock begins anew."""
        self._partial.clear()
        self._newest = -1
