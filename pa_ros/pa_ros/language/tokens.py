"""Program text to tokens: words, the signs ( ) and comma, and the end."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from typing import Literal, NamedTuple

from pa_ros.language.errors import UnexpectedCharacterError
from pa_ros.language.span import Span

Kind = Literal["word", "(", ")", ",", "end"]

_TOKEN = re.compile(r"[A-Za-z0-9_]+|[(),]")
_REFUSED = re.compile(r"[^A-Za-z0-9_(),\s]", re.ASCII)
_SIGNS: dict[str, Kind] = {"(": "(", ")": ")", ",": ","}


class Token(NamedTuple):
    """A word or sign and where it stands; the end's text is empty."""

    kind: Kind
    text: str
    span: Span

    def __str__(self) -> str:
        return "the end of the text" if self.kind == "end" else repr(self.text)


def tokenize(source: str) -> Iterator[Token]:
    """Yield the tokens of `source` from left to right, then one "end" token.

    Raises UnexpectedCharacterError, before any token, if a character can't be part of one.
    """
    if refused := _REFUSED.search(source):
        raise _unexpected(source, refused.start())
    for match in _TOKEN.finditer(source):
        text = match[0]
        yield Token(_SIGNS.get(text, "word"), text, Span(*match.span()))
    end = len(source.rstrip())
    yield Token("end", "", Span(end, end))


def _unexpected(source: str, position: int) -> UnexpectedCharacterError:
    character = source[position]
    name = unicodedata.name(character, "unnamed")
    plain = unicodedata.normalize("NFKC", character)  # full-width signs and letters
    return UnexpectedCharacterError(
        source,
        Span(position, position + 1),
        expected="ASCII letters, digits, '_', '(', ')' or ','",
        received=f"U+{ord(character):04X} ({name})",
        suggestion=repr(plain) if plain != character and not _REFUSED.search(plain) else None,
    )
