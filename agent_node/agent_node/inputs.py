"""The programs that an agent receives, by their ids."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

from pa_ros.core.errors import PaError
from pa_ros.language import Goal, Vocabulary, parse_goal
from pa_ros.wire.program import ProgramRequest

PROGRAMS = 256  # remembered


class ProgramBook:
    """The newest PROGRAMS programs by id; each text is parsed once."""

    def __init__(
        self, vocabulary: Vocabulary, check: Callable[[Goal], None] = lambda program: None
    ) -> None:
        """
        :param check: raises a PaError for a program that the agent can't act on.
        """
        self.vocabulary = vocabulary
        self._check = check
        self._texts: OrderedDict[str, str] = OrderedDict()  # canonical, by id
        self._programs: OrderedDict[str, Goal] = OrderedDict()  # by text

    def accept(self, request: ProgramRequest) -> str:
        """Remember a program; its canonical text.

        Raises ProgramError for a text that is no program, and PaError for one that can't be acted
        on, or whose id already names another program.
        """
        program = self.program(request.text)
        text = str(program)
        bound = self._texts.get(request.program_id, text)
        if bound != text:
            raise PaError(
                f"program_id: expected an id other than {request.program_id!r}, which names "
                f"{bound}, got it for {text}",
                code="program.id_taken",
            )
        self.name(request.program_id, text)
        self._check(program)
        return text

    def name(self, program_id: str, text: str) -> None:
        """Let an id name a canonical text, whatever it named before."""
        self._texts[program_id] = text
        if len(self._texts) > PROGRAMS:
            self._texts.popitem(last=False)

    def named(self, program_id: str, text: str) -> Goal | None:
        """The program of a canonical text, if the id names it."""
        return self._programs.get(text) if self._texts.get(program_id) == text else None

    def program(self, text: str) -> Goal:
        """The parsed text. Raises ProgramError."""
        program = self._programs.get(text)
        if program is None:
            program = self._programs[text] = parse_goal(text, self.vocabulary)
            if len(self._programs) > PROGRAMS:
                self._programs.popitem(last=False)
        return program
