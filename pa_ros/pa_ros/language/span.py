"""Places in program text, and how to show them in a terminal or a log line."""

from __future__ import annotations

from typing import NamedTuple

EXCERPT_WIDTH = 72
"""Characters of the source that an excerpt shows at most."""

EXCERPT_LEAD = 40
"""Characters shown before the caret at most."""


class Span(NamedTuple):
    """Characters `start` (included) to `end` (excluded) of a text, both 0-based."""

    start: int
    end: int


NOWHERE = Span(0, 0)
"""Span of a tree node that no text was parsed for."""


def location(source: str, position: int) -> str:
    """Name a place, 1-based: "column 12", or "line 2, column 12" in text of several lines."""
    column = position - source.rfind("\n", 0, position)
    if "\n" not in source:
        return f"column {column}"
    return f"line {source.count(chr(10), 0, position) + 1}, column {column}"


def excerpt(source: str, span: Span) -> str:
    """Show the line that `span` starts in, with a caret line under it.

    Long lines are cut to a window around the caret. The result is printable ASCII whatever the
    source holds, so it can't break a terminal, a log or a caret's alignment.
    """
    line_start = source.rfind("\n", 0, span.start) + 1
    line_end = source.find("\n", span.start)
    line_end = len(source) if line_end < 0 else line_end
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
