"""Waiting for events: tests never ask how long something took, only whether it comes at all."""

from __future__ import annotations

import time
from collections.abc import Callable

DEADLINE_S = 120.0  # far beyond what anything takes on a busy machine


def wait_for(condition: Callable[[], object], what: str = "an event") -> None:
    """Fail unless the condition comes to hold within DEADLINE_S."""
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline, f"timed out: {what}"
        time.sleep(0.02)


class Clock:
    """A clock of the test's own, in seconds."""

    now = 100.0

    def __call__(self) -> float:
        return self.now
