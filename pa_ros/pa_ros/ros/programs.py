"""What a node answers to a program."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from pa_ros.core.errors import PaError
from pa_ros.ros.refusals import Refusals
from pa_ros.wire.records import ProgramJudgement, ProgramRequest


def judge(
    request: ProgramRequest,
    node: str,
    stamp_ns: int,
    accept: Callable[[ProgramRequest], str],
    refusals: Refusals,
) -> ProgramJudgement:
    """What a node answers to a program; a refusal is counted, and says where in the text.

    `accept` returns the canonical text or raises a PaError.
    """
    judged = partial(ProgramJudgement, request.program_id, node, stamp_ns=stamp_ns)
    try:
        return judged(True, canonical=accept(request))
    except PaError as error:
        refusals.refuse("program", error)
        position = int(getattr(error, "position", -1))
        return judged(False, code=error.code, reason=str(error), position=position)
