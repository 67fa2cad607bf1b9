"""Waiting for events. Tests check whether something happened at all, never how long it took."""

import time
from collections.abc import Callable

DEADLINE_S = 120.0  # far longer than anything takes, even on a busy machine


def wait_for(condition: Callable[[], object], what: str = "an event") -> None:
    """Wait until the condition is true; fail after DEADLINE_S."""
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline, f"timed out: {what}"
        time.sleep(0.02)


class Clock:
    """A clock that the test sets, in seconds."""

    now = 100.0

    def __call__(self) -> float:
        return self.now
