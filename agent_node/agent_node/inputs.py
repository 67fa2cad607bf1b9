"""What an agent receives, put together: the parts of control steps, and programs by their ids."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable

from pa_ros.core.errors import PaError
from pa_ros.language import Program, Vocabulary, parse
from pa_ros.wire import Message
from pa_ros.wire.program import ProgramRequest

INCOMPLETE_STEPS = 8  # kept; in lockstep there are at most two
PROGRAMS = 256  # remembered


class StepMatcher:
    """Joins the messages of one control step by their stamp, which no other step has."""

    def __init__(self, parts: Iterable[str]) -> None:
        self._parts = frozenset(parts)
        self._incomplete: dict[int, dict[str, Message]] = {}  # by stamp
        self._newest = -1  # stamp of the newest complete step

    def add(self, part: str, stamp_ns: int, message: Message) -> dict[str, Message] | None:
        """Add a message; return the messages of its step by part if the step is now complete.

        Raises PaError for a step older than the newest complete one. That one itself may be
        repeated: an arena that received no command sends its step again.
        """
        if stamp_ns < self._newest:
            raise PaError(
                f"{part}: expected a stamp of at least {self._newest} ns, got {stamp_ns}",
                code="observation.stale",
            )
        step = self._incomplete.setdefault(stamp_ns, {})
        step[part] = message
        if len(step) < len(self._parts):
            if len(self._incomplete) > INCOMPLETE_STEPS:
                del self._incomplete[min(self._incomplete)]
            return None
        self._newest = stamp_ns
        if len(self._incomplete) == 1:
            self._incomplete.clear()
        else:
            self._incomplete = {k: v for k, v in self._incomplete.items() if k > stamp_ns}
        return step

    @property
    def lacking(self) -> list[str]:
        """Parts that the newest incomplete step lacks; empty if no step is incomplete."""
        newest = self._incomplete[max(self._incomplete)] if self._incomplete else self._parts
        return sorted(self._parts.difference(newest))

    def restart(self) -> None:
        """Forget everything: the clock of another arena starts at zero."""
        self._incomplete.clear()
        self._newest = -1


class ProgramBook:
    """The newest PROGRAMS programs by id; each text is parsed once."""

    def __init__(
        self, vocabulary: Vocabulary, check: Callable[[Program], None] = lambda program: None
    ) -> None:
        """
        :param check: raises a PaError for a program that the agent can't act on.
        """
        self.vocabulary = vocabulary
        self._check = check
        self._texts: OrderedDict[str, str] = OrderedDict()  # canonical, by id
        self._programs: OrderedDict[str, Program] = OrderedDict()  # by text

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

    def named(self, program_id: str, text: str) -> Program | None:
        """The program of a canonical text, if the id names it."""
        return self._programs.get(text) if self._texts.get(program_id) == text else None

    def program(self, text: str) -> Program:
        """The parsed text. Raises ProgramError."""
        program = self._programs.get(text)
        if program is None:
            program = self._programs[text] = parse(text, self.vocabulary)
            if len(self._programs) > PROGRAMS:
                self._programs.popitem(last=False)
        return program
