"""Hearing programs from everyone: latched ones from before, and those of plain publishers."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from rclpy.node import Node

from pa_ros.core.errors import PaError
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import PROGRAM, PROGRAM_LIVE
from pa_ros.wire import codec
from pa_ros.wire.interfaces import Message
from pa_ros.wire.records import ProgramJudgement, ProgramRequest

TWIN_S = 2.0


class Twins:
    """Tells which of two readers' deliveries are one and the same message.

    A TRANSIENT_LOCAL reader hears latched programs and a VOLATILE one hears every writer, so a
    message may come once or twice: the second time from the other reader, and soon.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._alone: dict[tuple[int, ProgramRequest], list[float]] = {}

    def is_new(self, reader: int, request: ProgramRequest) -> bool:
        """Whether a delivery to reader 0 or 1 is not the twin of one to the other."""
        now = self._clock()
        self._alone = {
            key: recent
            for key, times in self._alone.items()
            if (recent := [when for when in times if now - when < TWIN_S])
        }
        if times := self._alone.get((1 - reader, request)):
            times.pop(0)
            return False
        self._alone.setdefault((reader, request), []).append(now)
        return True


def subscribe_programs(
    node: Node, callback: Callable[[ProgramRequest], None], refusals: Refusals
) -> None:
    """Call back once per program published on `program`, latched ones of the past included."""
    twins = Twins()

    def receive(reader: int, message: Message) -> None:
        request = codec.decode_program(message)
        if twins.is_new(reader, request):
            callback(request)

    for reader, topic in enumerate((PROGRAM, PROGRAM_LIVE)):
        guarded = refusals.guard(topic.name, partial(receive, reader))
        topic.subscribe(node, guarded)


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
