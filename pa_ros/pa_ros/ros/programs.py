"""What a node answers to a program, and how many it answers."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from pa_ros.core.errors import PaError
from pa_ros.ros.refusals import Refusals
from pa_ros.wire.program import ProgramRequest, ProgramStatus

PER_S, BURST = 50.0, 100.0  # programs that are judged: a second, and at once


class TooManyProgramsError(PaError):
    """More programs than are judged; they get no answer."""

    code = "program.too_many"


class Pace:
    """Bounds what programs can cost a node that has an arm to move."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._left, self._at = BURST, clock()

    def check(self) -> None:
        """Count a program. Raises TooManyProgramsError if it is one too many."""
        now = self._clock()
        self._left, self._at = min(BURST, self._left + (now - self._at) * PER_S), now
        if self._left < 1.0:
            raise TooManyProgramsError(
                f"program: expected at most {PER_S:g} programs a second, got more, which are not "
                "judged: who sends them?"
            )
        self._left -= 1.0


def judge(
    request: ProgramRequest,
    node: str,
    stamp_ns: int,
    accept: Callable[[ProgramRequest], str],
    refusals: Refusals,
) -> ProgramStatus:
    """What a node answers to a program; a refusal is counted, and says where in the text.

    `accept` returns the canonical text or raises a PaError.
    """
    judged = partial(ProgramStatus, request.program_id, node, stamp_ns=stamp_ns)
    try:
        return judged(True, canonical=accept(request))
    except PaError as error:
        refusals.refuse("program", error)
        position = int(getattr(error, "position", -1))
        return judged(False, code=error.code, reason=str(error), position=position)
