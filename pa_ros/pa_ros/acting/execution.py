"""Whether a program was executed, according to the verdicts that an arena publishes."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from pa_ros.core.experience import Verdict

WINDOW_S = 10.0  # simulation time that a program is given: an episode of the paper
HOLD_S = 1.0  # simulation time for which NEAR must hold


@dataclass(frozen=True, slots=True)
class Execution:
    """The result of executing one program."""

    satisfied: bool  # NEAR held for HOLD_S, or still held when the window or the episode ended
    distance: float  # m, hand to the nearest object named, at the last step watched; inf: none
    reached_s: float | None  # simulation time from its first step to NEAR for good; None: never
    watched_s: float  # simulation time from the program's first step to the last step watched
    ended: str  # by: "held", "window", "episode" or "replaced" (by another program)


class ExecutionWatch:
    """Watches verdicts, in their order, until the result of one program is certain.

    Steps under other programs before the program's first step are ignored, unless they are later
    than its acceptance. A step of another program or episode after its first step ends the watch.
    """

    def __init__(self, program_id: str, window_s: float = WINDOW_S, hold_s: float = HOLD_S) -> None:
        self._program_id = program_id
        self._window_ns, self._hold_ns = round(window_s * 1e9), round(hold_s * 1e9)
        self._first: Verdict | None = None
        self._last: Verdict | None = None
        self._near_since_ns: int | None = None
        self._accepted_ns: int | None = None

    @property
    def begun(self) -> bool:
        """Whether a step under the program was seen."""
        return self._first is not None

    def accepted(self, stamp_ns: int) -> None:
        """The program was accepted while the step of this stamp was current."""
        self._accepted_ns = max(stamp_ns, self._accepted_ns or 0)

    def observe(self, verdict: Verdict) -> Execution | None:
        """Take in one verdict. Returns the result once it is certain."""
        if verdict.program_id != self._program_id or self._other_episode(verdict):
            over = self._last is not None or self._replaced_early(verdict)
            return self._finish("replaced") if over else None
        self._first = self._first or verdict
        self._last = verdict
        if not verdict.satisfied:
            self._near_since_ns = None
        elif self._near_since_ns is None:
            self._near_since_ns = verdict.stamp_ns
        return self._result(verdict)

    def _replaced_early(self, verdict: Verdict) -> bool:
        """Whether another program replaced this one before its first step."""
        return self._accepted_ns is not None and verdict.stamp_ns > self._accepted_ns

    def _other_episode(self, verdict: Verdict) -> bool:
        return self._last is not None and verdict.episode != self._last.episode

    def _result(self, verdict: Verdict) -> Execution | None:
        since, first = self._near_since_ns, self._first
        assert first is not None
        if since is not None and verdict.stamp_ns - since >= self._hold_ns:
            return self._finish("held")
        if verdict.truncated:
            return self._finish("episode")
        if verdict.stamp_ns - first.stamp_ns >= self._window_ns:
            return self._finish("window")
        return None

    def _finish(self, ended: str) -> Execution:
        first, last = self._first, self._last
        if first is None or last is None:
            return Execution(False, inf, None, 0.0, ended)
        satisfied = self._near_since_ns is not None and ended != "replaced"
        reached_s = None
        if satisfied and self._near_since_ns is not None:
            reached_s = (self._near_since_ns - first.stamp_ns) / 1e9
        watched_s = (last.stamp_ns - first.stamp_ns) / 1e9
        return Execution(satisfied, last.distance, reached_s, watched_s, ended)
