"""Rejected programs: one error class with a code, and messages with a caret under the fault."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from pa_ros.core.errors import PaError
from pa_ros.core.text import nearest
from pa_ros.language.syntax import Program, Span

SHOWN_WORDS = 16
"""Words that an "expected" list names before it is cut."""

SHOWN_CHARACTERS = 32
"""Characters of a received word that a message repeats."""

EXCERPT_WIDTH = 72
"""Characters of the source that an excerpt shows at most."""

EXCERPT_LEAD = 40
"""Characters before the caret that an excerpt shows at most."""

SUMMARIES = {
    "program.empty": "empty program",
    "program.too_long": "program too long",
    "program.too_deep": "program too deep",
    "program.too_large": "program too large",
    "program.unexpected_character": "unexpected character",
    "program.unknown_word": "unknown word",
    "program.wrong_case": "wrong case",
    "program.arity": "wrong number of arguments",
    "program.syntax": "syntax error",
    "program.names_nothing": "no such object",
    "program.needs_body": "nothing to move",
    "program.needs_support": "nothing to rest on",
    "program.itself": "object related to itself",
    "program.hand": "wrong relation of the hand",
    "program.avoids_target": "target to be avoided",
    "program.over_time": "goal over time",
    "program.avoids": "nothing can be avoided",
    "program.moves": "nothing can be moved",
    "program.compares": "nothing can be compared",
}
"""Every code of a ProgramError, with the words for it in the message."""


class ProgramError(PaError):
    """A rejected program. `str()` gives the message and, unless the text is blank, an excerpt of
    the source with a caret, in ASCII.

    Attributes: `code` (a key of SUMMARIES), `source` (the text), `span` (the characters at fault),
    `expected` and `received` (in words) and `suggestion` (the nearest valid word, or None).
    """

    def __init__(
        self,
        source: str,
        span: Span,
        *,
        code: str,
        expected: str,
        received: str,
        suggestion: str | None = None,
    ) -> None:
        self.source, self.span = source, span
        self.expected, self.received, self.suggestion = expected, received, suggestion
        hint = f"; did you mean {suggestion}?" if suggestion else ""
        where, summary = _location(source, span.start), SUMMARIES[code]
        self.message = f"{where}: {summary}: expected {expected}, received {received}{hint}"
        """One line, without the excerpt."""
        super().__init__(self.message, code)

    @property
    def position(self) -> int:
        """First character at fault, 0-based; the length of the text if something is missing."""
        return self.span.start

    def __str__(self) -> str:
        blank = not self.source or self.source.isspace()
        return self.message if blank else f"{self.message}\n{excerpt(self.source, self.span)}"


def unknown_word(source: str, span: Span, received: str, known: Iterable[str]) -> ProgramError:
    """An error for a word outside `known`: wrong case if its upper case is known, else unknown."""
    words = tuple(known)
    cut = len(received) > SHOWN_CHARACTERS
    shown = received[: SHOWN_CHARACTERS - 3] + "..." if cut else received
    wrong_case = received.upper() in words
    return ProgramError(
        source,
        span,
        code="program.wrong_case" if wrong_case else "program.unknown_word",
        expected=received.upper() if wrong_case else one_of(words),
        received=repr(shown),
        suggestion=nearest(received.upper(), words),
    )


def check_words(program: Program, known: Mapping[str, int]) -> None:
    """Raise ProgramError (program.unknown_word) if the program has a word outside `known`."""
    for word in program.words:
        if word not in known:
            raise foreign_word(program, word, known)


def foreign_word(program: Program, word: str, known: Iterable[str]) -> ProgramError:
    """An error for a program of another vocabulary, with a caret in its canonical text."""
    source = str(program)
    place = re.search(rf"\b{re.escape(word)}\b", source)
    assert place is not None
    return unknown_word(source, Span(*place.span()), word, known)


def cannot_avoid(program: Program) -> ProgramError:
    """An error for a program that avoids a set, where networks have no input for it."""
    source, expected = str(program), "a program without AVOID for these networks"
    span = Span(0, len("AVOID"))
    return ProgramError(source, span, code="program.avoids", expected=expected, received="AVOID")


def cannot_move(program: Program) -> ProgramError:
    """An error for a program that moves objects, where networks move the hand alone."""
    source, received = str(program), program.arguments[0]
    start = source.index(f"{program.relation}(") + len(program.relation) + 1
    span = Span(start, start + len(received))
    expected = "HAND, as programs of this world move the hand alone"
    return ProgramError(source, span, code="program.moves", expected=expected, received=received)


def one_of(words: Iterable[str]) -> str:
    """Join for an "expected" list: "A", "A or B", "A, B or C"; cut after SHOWN_WORDS."""
    shown = list(words)
    if len(shown) > SHOWN_WORDS:
        shown[SHOWN_WORDS:] = [f"{len(shown) - SHOWN_WORDS} more"]
    *first, last = shown
    return f"{', '.join(first)} or {last}" if first else last


def _location(source: str, position: int) -> str:
    """A place in words, 1-based: "column 12", or "line 2, column 12" in text of several lines."""
    before = source[:position]
    column = position - before.rfind("\n")
    if "\n" not in source:
        return f"column {column}"
    return f"line {len(before.split(chr(10)))}, column {column}"


def excerpt(source: str, span: Span) -> str:
    """The line in which `span` starts, with a caret line under it.

    Long lines are cut to a window around the caret. The result is printable ASCII for every source,
    so that it cannot break a terminal, a log or the alignment of the caret.
    """
    line_start = source[: span.start].rfind("\n") + 1
    line_end = f"{source}\n".index("\n", span.start)
    left = max(line_start, span.start - EXCERPT_LEAD)
    right = min(line_end, left + EXCERPT_WIDTH)
    before = "..." if left > line_start else ""
    after = "..." if right < line_end else ""
    shown = before + "".join(map(_printable, source[left:right])) + after
    tail = "~" * (min(span.end, right) - span.start - 1)
    return f"  {shown}\n  {' ' * (len(before) + span.start - left)}^{tail}"


def _printable(character: str) -> str:
    if character.isspace():
        return " "
    return character if character.isascii() and character.isprintable() else "?"
