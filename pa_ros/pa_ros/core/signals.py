"""Signals that ask a command to come to its end."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

EXIT_INTERRUPTED = 130  # as a shell says of SIGINT


@contextmanager
def signals_noted() -> Iterator[Callable[[], bool]]:
    """SIGINT, SIGTERM and SIGHUP make the function yielded true instead of ending the process.

    The next one raises KeyboardInterrupt, so that impatience is heard while things are stopped.
    """
    noted: list[int] = []

    def handle(number: int, _frame: FrameType | None) -> None:
        noted.append(number)
        if len(noted) > 1:
            raise KeyboardInterrupt

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield lambda: bool(noted)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
