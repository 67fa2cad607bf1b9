"""Programs that an agent has judged, by the id that they were sent under."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

from pa_ros.language import Program, Vocabulary, parse
from pa_ros.wire.errors import ProgramIdError
from pa_ros.wire.records import ProgramRequest

REMEMBERED = 256


class ProgramBook:
    """Programs by id, the newest REMEMBERED of them."""

    def __init__(
        self, vocabulary: Vocabulary, check: Callable[[Program], None] = lambda program: None
    ) -> None:
        """`check` raises a PaError for a program that the agent cannot act on."""
        self.vocabulary = vocabulary
        self._check = check
        self._texts: OrderedDict[str, str] = OrderedDict()  # canonical ones and as sent, by id
        self._programs: OrderedDict[str, Program] = OrderedDict()  # by text

    def accept(self, request: ProgramRequest) -> str:
        """Remember a program; its canonical text. Raises ProgramError if it isn't one, a PaError
        if it cannot be acted on, ProgramIdError if its id stands for another."""
        program = parse(request.text, self.vocabulary)
        text = str(program)
        bound = self._texts.get(request.program_id, text)
        if bound != text:
            raise ProgramIdError(
                f"program_id: expected another one than {request.program_id!r}, which stands for "
                f"{bound}, got {text} under it"
            )
        self.note(request.program_id, text)
        self._check(program)
        return text

    def note(self, program_id: str, text: str) -> None:
        """An id stands for a canonical text, whatever it stood for."""
        _remember(self._texts, program_id, text)

    def stands_for(self, program_id: str) -> str:
        """The canonical text of an id; empty if it was not heard of."""
        return self._texts.get(program_id, "")

    def program(self, text: str) -> Program:
        """The program of a text, parsed once. Raises ProgramError."""
        program = self._programs.get(text)
        if program is None:
            program = parse(text, self.vocabulary)
            self._programs[text] = program
            while len(self._programs) > REMEMBERED:
                self._programs.popitem(last=False)
        return program


def _remember(texts: OrderedDict[str, str], program_id: str, text: str) -> None:
    texts[program_id] = text
    texts.move_to_end(program_id)
    while len(texts) > REMEMBERED:
        texts.popitem(last=False)
