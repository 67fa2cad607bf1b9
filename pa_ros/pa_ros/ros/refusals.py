"""Bad input is refused, logged with its cause, and counted; the node goes on."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import TypeVar

from pa_ros.core.errors import PaError

LOG_PERIOD_S = 5.0
Argument = TypeVar("Argument")


class Refusals:
    """Counts refusals by code; logs the first of a code, then at most one each LOG_PERIOD_S.

    Any thread may refuse and ask.
    """

    def __init__(
        self,
        log: Callable[[str], object],
        clock: Callable[[], float] = time.monotonic,
        period_s: float = LOG_PERIOD_S,
    ) -> None:
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter()
        self._log = log
        self._clock = clock
        self._period_s = period_s
        self._logged: dict[str, tuple[float, int]] = {}  # code → when, count then

    def refuse(self, where: str, error: PaError) -> None:
        """Count a refusal, and log it unless one of its code was logged just now."""
        with self._lock:
            line = self._counted(where, error)
        if line:
            self._log(line)

    def _counted(self, where: str, error: PaError) -> str:
        """What to log of a refusal; empty: nothing this time."""
        code = error.code
        self._counts[code] += 1
        now = self._clock()
        when, count = self._logged.get(code, (-self._period_s, 0))
        if now - when < self._period_s:
            return ""
        self._logged[code] = (now, self._counts[code])
        silent = self._counts[code] - count - 1
        more = f" ({silent} more since the last report)" if silent else ""
        return f"refused: {where}: [{code}] {error}{more}"

    def guard(self, where: str, callback: Callable[[Argument], None]) -> Callable[[Argument], None]:
        """The callback, with typed errors turned into refusals. Other errors are bugs, and pass."""

        def guarded(argument: Argument) -> None:
            try:
                callback(argument)
            except PaError as error:
                self.refuse(where, error)

        return guarded

    @property
    def counts(self) -> Counter[str]:
        """A copy: refusals by code."""
        with self._lock:
            return self._counts.copy()

    @property
    def total(self) -> int:
        """All refusals so far."""
        return self.counts.total()

    def values(self) -> dict[str, str]:
        """Counts for /diagnostics."""
        return {f"refused.{code}": str(count) for code, count in sorted(self.counts.items())}
