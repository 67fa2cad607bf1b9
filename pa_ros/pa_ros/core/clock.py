"""Time stamps from a clock that never jumps."""

import time

_STARTED_NS = time.time_ns() - time.monotonic_ns()


def now_ns() -> int:
    """Wall time when this process began, plus the monotonic time since, in ns.

    A wall clock that is set back or ahead later changes no age, order or duration of stamps.
    """
    return _STARTED_NS + time.monotonic_ns()
