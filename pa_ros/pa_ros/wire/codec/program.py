"""Programs and the answers to them."""

from __future__ import annotations

from pa_ros.language import Program as LanguageProgram
from pa_ros.language import parse
from pa_ros.wire import errors
from pa_ros.wire.codec.stamp import read_stamp, write_stamp
from pa_ros.wire.interfaces import ArenaInfo, Program, ProgramStatus, Provenance
from pa_ros.wire.records import ProgramJudgement, ProgramRequest, program_id_of
from pa_ros.world.world import World

MAX_TEXT = 100_000  # characters handed on; the language's own limit is lower and is what refuses
MAX_ID = 256


def encode_program(request: ProgramRequest) -> Program:
    """A program to execute."""
    return Program(program_id=request.program_id, text=request.text)


def decode_program(message: Program) -> ProgramRequest:
    """Any text passes, cut where it is far beyond what the parser would take: the parser judges.

    Without an id it gets one that is a function of the text. Raises RangeError for a long id.
    """
    if len(message.program_id) > MAX_ID:
        size = len(message.program_id)
        raise errors.RangeError("program.program_id", f"at most {MAX_ID} characters", size)
    return ProgramRequest(
        message.program_id or program_id_of(message.text), message.text[:MAX_TEXT]
    )


def read_programs(message: ArenaInfo | Provenance, world: World) -> tuple[LanguageProgram, ...]:
    """Training programs over a world's words. Raises ProgramError."""
    return tuple(parse(text, world.vocabulary) for text in message.training_programs)


def encode_program_status(judgement: ProgramJudgement) -> ProgramStatus:
    """One node's answer to a program."""
    message = ProgramStatus(
        program_id=judgement.program_id,
        node=judgement.node,
        status=ProgramStatus.ACCEPTED if judgement.accepted else ProgramStatus.REFUSED,
        canonical=judgement.canonical,
        code=judgement.code,
        reason=judgement.reason,
        position=judgement.position,
    )
    write_stamp(message.stamp, judgement.stamp_ns)
    return message


def decode_program_status(message: ProgramStatus) -> ProgramJudgement:
    """Raises RangeError for a status that is neither."""
    if message.status not in (ProgramStatus.ACCEPTED, ProgramStatus.REFUSED):
        raise errors.RangeError("program_status.status", "ACCEPTED or REFUSED", message.status)
    return ProgramJudgement(
        program_id=message.program_id,
        node=message.node,
        accepted=message.status == ProgramStatus.ACCEPTED,
        canonical=message.canonical,
        code=message.code,
        reason=message.reason,
        position=message.position,
        stamp_ns=read_stamp(message.stamp),
    )
