"""Why a program was refused: each kind of refusal is a class with its own `code`."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from pa_ros.core.errors import PaError
from pa_ros.language.span import Span, excerpt, location

SHOWN_WORDS = 16
"""Words that an "expected" list names before it is cut."""

SHOWN_CHARACTERS = 32
"""Characters of a received word that a message repeats."""


class ProgramError(PaError):
    """A program refused. `str()` gives the message and, unless the text is blank, an excerpt
    with a caret, in ASCII.

    Attributes: `source` (the text), `span` (half-open, 0-based characters of the source),
    `position` (where the span starts), `expected` and `received` (words for people) and
    `suggestion` (the nearest thing that would do, or None).
    """

    code = "program"
    summary = "program refused"

    def __init__(
        self,
        source: str,
        span: Span,
        *,
        expected: str,
        received: str,
        suggestion: str | None = None,
    ) -> None:
        self.source = source
        self.span = span
        self.expected = expected
        self.received = received
        self.suggestion = suggestion
        super().__init__(self.message)

    @property
    def position(self) -> int:
        """First refused character, 0-based; the length of the text if something is missing."""
        return self.span.start

    @property
    def message(self) -> str:
        """One line, without the excerpt."""
        hint = f"; did you mean {self.suggestion}?" if self.suggestion else ""
        where = location(self.source, self.position)
        return f"{where}: {self.summary}: expected {self.expected}, received {self.received}{hint}"

    def __str__(self) -> str:
        blank = not self.source or self.source.isspace()
        return self.message if blank else f"{self.message}\n{excerpt(self.source, self.span)}"


class EmptyProgramError(ProgramError):
    """No characters but white space."""

    code = "program.empty"
    summary = "empty program"


class ProgramTooLongError(ProgramError):
    """More characters than `limits.MAX_LENGTH`, as sent or in canonical form."""

    code = "program.too_long"
    summary = "program too long"


class ProgramTooDeepError(ProgramError):
    """Expressions nested deeper than `limits.MAX_DEPTH`."""

    code = "program.too_deep"
    summary = "program too deep"


class ProgramTooLargeError(ProgramError):
    """More words and operators than `limits.MAX_NODES`."""

    code = "program.too_large"
    summary = "program too large"


class UnexpectedCharacterError(ProgramError):
    """A character that no program contains, such as a non-ASCII one."""

    code = "program.unexpected_character"
    summary = "unexpected character"


class UnknownWordError(ProgramError):
    """A word that is neither an operator nor in the vocabulary."""

    code = "program.unknown_word"
    summary = "unknown word"


class WrongCaseError(ProgramError):
    """A known word that isn't written in upper case."""

    code = "program.wrong_case"
    summary = "wrong case"


class ArityError(ProgramError):
    """An operator with too few or too many arguments."""

    code = "program.arity"
    summary = "wrong number of arguments"


class ProgramSyntaxError(ProgramError):
    """Known words and signs in an order that the grammar does not have."""

    code = "program.syntax"
    summary = "syntax error"


class NamesNothingError(ProgramError):
    """A well-formed program whose target is not in the scene."""

    code = "program.names_nothing"
    summary = "no such object"


def refuse_word(
    source: str, span: Span, received: str, known: Iterable[str]
) -> UnknownWordError | WrongCaseError:
    """Error for a word outside `known`: wrong case if upper-casing it helps, else unknown."""
    words = tuple(known)
    kind = WrongCaseError if received.upper() in words else UnknownWordError
    nearest = difflib.get_close_matches(received.upper(), words, n=1)
    return kind(
        source,
        span,
        expected=one_of(words) if kind is UnknownWordError else received.upper(),
        received=repr(shorten(received)),
        suggestion=nearest[0] if nearest else None,
    )


def one_of(words: Iterable[str]) -> str:
    """Join for an "expected" list: "A", "A or B", "A, B or C"; cut after SHOWN_WORDS."""
    shown = list(words)
    if len(shown) > SHOWN_WORDS:
        shown[SHOWN_WORDS:] = [f"{len(shown) - SHOWN_WORDS} more"]
    *first, last = shown
    return f"{', '.join(first)} or {last}" if first else last


def shorten(text: str) -> str:
    """At most SHOWN_CHARACTERS of a text, with dots for what was cut."""
    return text if len(text) <= SHOWN_CHARACTERS else text[: SHOWN_CHARACTERS - 3] + "..."
