"""Text from outside, of which nothing is known."""

from __future__ import annotations

LONGEST = 1000  # characters shown
DIGITS = 18  # of the greatest number that is read


def printable(text: str) -> str:
    """What a terminal can show without moving its cursor: escapes for the rest; cut at LONGEST."""
    return _escaped(text if len(text) <= LONGEST else text[: LONGEST - 1] + "…")


def printable_lines(text: str) -> str:
    """The same of several lines, which they stay; nothing is cut."""
    return "\n".join(map(_escaped, text.split("\n")))


def natural(text: str) -> int | None:
    """The number that ASCII digits say; None for anything else, and for more than DIGITS."""
    if len(text) > DIGITS or not (text.isascii() and text.isdecimal()):
        return None
    return int(text)


def _escaped(text: str) -> str:
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
