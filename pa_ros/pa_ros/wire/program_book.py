"""The programs that a node has received, by their ids."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import TypeVar

from pa_ros.language import Goal, Vocabulary, parse_goal
from pa_ros.wire import WireError
from pa_ros.wire.program import ProgramRequest

PROGRAMS = 4096  # remembered

T = TypeVar("T")


class ProgramBook:
    """The newest PROGRAMS programs by id; each text is parsed once."""

    def __init__(
        self,
        vocabulary: Vocabulary,
        check: Callable[[Goal], None] = lambda program: None,
        own: str = "",
    ) -> None:
        """
        :param check: raises a PaError for a program that can't be executed.
        :param own: the node's programs have ids that begin so, which others may not use; empty: it
            has none.
        """
        self.vocabulary = vocabulary
        self._check, self._own = check, own
        self._texts: OrderedDict[str, str] = OrderedDict()  # canonical, by id
        self._programs: OrderedDict[str, Goal] = OrderedDict()  # by text

    def accept(self, request: ProgramRequest) -> str:
        """Remember a program; its canonical text.

        Raises ProgramError for a text that is no program, WireError if its id is not free for it,
        and what `check` raises.
        """
        program = self.program(request.text)
        text = str(program)
        self.bind(request.program_id, text)
        self._check(program)
        return text

    def bind(self, program_id: str, text: str) -> None:
        """Let an id name a canonical text. Raises WireError if the id isn't free for it."""
        if self.is_own(program_id):
            expected = f"one that does not begin with {self._own!r} (the arena's own programs)"
            raise WireError("program_id", expected, repr(program_id), code="program.id_taken")
        known = self._texts.get(program_id, text)
        if known != text:
            expected = f"another id than {program_id!r}, which means {known}"
            raise WireError("program_id", expected, f"{text} with that id", code="program.id_taken")
        self.name(program_id, text)

    def is_own(self, program_id: str) -> bool:
        """Whether an id is one of the node's own programs."""
        return bool(self._own) and program_id.startswith(self._own)

    def name(self, program_id: str, text: str) -> None:
        """Let an id name a canonical text, whatever it named before."""
        _keep(self._texts, program_id, text)

    def named(self, program_id: str, text: str) -> Goal | None:
        """The program of a canonical text, if the id names it."""
        return self._programs.get(text) if self._texts.get(program_id) == text else None

    def program(self, text: str) -> Goal:
        """The parsed text. Raises ProgramError."""
        program = self._programs.get(text)
        if program is None:
            program = parse_goal(text, self.vocabulary)
            _keep(self._programs, text, program)
        return program


def _keep(newest: OrderedDict[str, T], name: str, value: T) -> None:
    """Remember a value as the newest; the oldest of more than PROGRAMS is forgotten."""
    newest[name] = value
    newest.move_to_end(name)
    if len(newest) > PROGRAMS:
        newest.popitem(last=False)
