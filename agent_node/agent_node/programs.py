"""Programs that an agent has heard of, by the id that observations name them by."""

from __future__ import annotations

from collections import OrderedDict
from typing import TypeVar

from pa_ros.core.errors import ConfigError
from pa_ros.language import Program, Vocabulary, parse
from pa_ros.wire.records import ArenaDescription, ProgramJudgement, ProgramRequest

REMEMBERED = 256
T = TypeVar("T")


class ProgramBook:
    """Programs by id, the newest REMEMBERED of them."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.vocabulary = vocabulary
        self._programs: OrderedDict[str, Program] = OrderedDict()

    def accept(self, request: ProgramRequest) -> str:
        """Remember a program; its canonical text. Raises ProgramError if it isn't one."""
        program = parse(request.text, self.vocabulary)
        _remember(self._programs, request.program_id, program)
        return str(program)

    def program_of(self, program_id: str) -> Program | None:
        """What an id stands for; None if it has not been heard of, or is empty."""
        return self._programs.get(program_id)


class HeardByOthers:
    """Programs that other nodes accepted, the newest REMEMBERED: their senders may be gone."""

    def __init__(self) -> None:
        self._texts: OrderedDict[str, str] = OrderedDict()

    def note(self, judgement: ProgramJudgement) -> None:
        """Remember a judgement's program if it was accepted."""
        if judgement.accepted:
            _remember(self._texts, judgement.program_id, judgement.canonical)

    def take(self, program_id: str) -> ProgramRequest | None:
        """The program of an id, once; None if nobody is known to have heard it."""
        text = self._texts.pop(program_id, None)
        return None if text is None else ProgramRequest(program_id, text)


def _remember(programs: OrderedDict[str, T], program_id: str, program: T) -> None:
    programs[program_id] = program
    programs.move_to_end(program_id)
    while len(programs) > REMEMBERED:
        programs.popitem(last=False)


def vocabulary_of(arena: ArenaDescription) -> Vocabulary:
    """The arena's words. Raises ConfigError if they are none, or not what the digest says."""
    vocabulary = Vocabulary.of(shape=arena.shapes, color=arena.colors)
    if vocabulary.digest != arena.vocabulary_digest:
        raise ConfigError(
            f"arena_info.vocabulary_digest: expected {vocabulary.digest} for these words, "
            f"got {arena.vocabulary_digest}"
        )
    return vocabulary
