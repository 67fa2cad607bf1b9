"""Refused input: logged with its cause and counted, while the node continues."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import TypeVar

from pa_ros.core.errors import PaError
from pa_ros.wire.program import ProgramRequest, ProgramStatus

LOG_PERIOD_S = 5.0
KEPT_S = 3.0  # a refusal is remembered for so long, however many other messages are accepted
PROGRAMS_PER_S, PROGRAMS_AT_ONCE = 50.0, 100.0
Argument = TypeVar("Argument")


class Refusals:
    """Counts refusals by error code. Logs the first of a code, then one each `period_s`.

    Remembers the newest refusal of each guarded topic until a message of it is accepted. May be
    used by several threads.
    """

    def __init__(
        self,
        log: Callable[[str], object],
        clock: Callable[[], float] = time.monotonic,
        period_s: float = LOG_PERIOD_S,
    ) -> None:
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter()
        self._log, self._clock, self._period_s = log, clock, period_s
        self._logged: dict[str, tuple[float, int]] = {}  # code → when, and the count then
        self._guarded: set[str] = set()
        # Guarded topic → when, why, and whether a message was accepted since then
        self._newest: dict[str, tuple[float, str, bool]] = {}

    def refuse(self, where: str, error: PaError) -> None:
        """Count a refusal, and log it unless one with its code was logged just before."""
        code, now = error.code, self._clock()
        with self._lock:
            if where in self._guarded:
                self._newest[where] = now, str(error).partition("\n")[0], False
            self._counts[code] += 1
            count = self._counts[code]
            logged_at, logged_count = self._logged.get(code, (-self._period_s, 0))
            if now - logged_at < self._period_s:
                return
            self._logged[code] = now, count
        more = count - logged_count - 1
        suffix = f" ({more} more since the last report)" if more else ""
        self._log(f"refused: {where}: [{code}] {error}{suffix}")

    def guard(self, where: str, callback: Callable[[Argument], None]) -> Callable[[Argument], None]:
        """The callback with each PaError turned into a refusal. Other errors are bugs: they end
        the node."""
        self._guarded.add(where)

        def guarded(argument: Argument) -> None:
            before = self._newest.get(where)
            try:
                callback(argument)
            except PaError as error:
                self.refuse(where, error)
            else:
                self._accepted(where, before)

        return guarded

    def _accepted(self, where: str, before: tuple[float, str, bool] | None) -> None:
        """A message was accepted, unless its callback refused a part of it."""
        with self._lock:
            if before is not None and self._newest[where] is before:
                self._newest[where] = *before[:2], True

    @property
    def newest(self) -> list[tuple[str, str]]:
        """Topics whose newest messages are refused, each with the reason; the latest first.

        After one is accepted this lasts for KEPT_S, because another publisher may continue to send
        bad ones.
        """
        now = self._clock()
        with self._lock:
            latest = sorted(self._newest.items(), key=lambda one: one[1][0], reverse=True)
        return [
            (where, reason)
            for where, (at, reason, accepted) in latest
            if not accepted or now - at < KEPT_S
        ]

    @property
    def counts(self) -> Counter[str]:
        """Number of refusals by code; a copy."""
        with self._lock:
            return self._counts.copy()

    @property
    def total(self) -> int:
        """Number of refusals."""
        return self.counts.total()

    def values(self) -> dict[str, str]:
        """The counts as values for /diagnostics."""
        return {f"refused.{code}": str(count) for code, count in sorted(self.counts.items())}


class RateLimiter:
    """Limits how many programs or goals a node checks, so that many of them don't slow the arm."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._left, self._at = PROGRAMS_AT_ONCE, clock()

    def check(self) -> None:
        """Count one. Raises PaError (`program.too_many`) if it exceeds the limit."""
        now = self._clock()
        refilled = self._left + (now - self._at) * PROGRAMS_PER_S
        self._left, self._at = min(PROGRAMS_AT_ONCE, refilled), now
        if self._left < 1.0:
            raise PaError(
                f"expected at most {PROGRAMS_PER_S:g} a second, got more, which are ignored: find "
                "out who sends them",
                code="program.too_many",
            )
        self._left -= 1.0


def answer_program(
    request: ProgramRequest,
    node: str,
    stamp_ns: int,
    accept: Callable[[ProgramRequest], str],
    refusals: Refusals,
) -> ProgramStatus:
    """A node's answer to a program: accepted, or refused with the reason and the place in it.

    :param accept: returns the canonical text, or raises a PaError.
    """
    try:
        canonical = accept(request)
    except PaError as error:
        refusals.refuse("program", error)
        position = int(getattr(error, "position", -1))
        return ProgramStatus(
            request.program_id,
            node,
            accepted=False,
            code=error.code,
            reason=str(error),
            position=position,
            stamp_ns=stamp_ns,
        )
    return ProgramStatus(request.program_id, node, True, canonical, stamp_ns=stamp_ns)
