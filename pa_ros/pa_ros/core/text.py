"""Text from outside, of which nothing is known."""

from __future__ import annotations

LONGEST = 1000  # characters shown
DIGITS = 18  # of the greatest number that is read


def printable(text: str) -> str:
    """What a terminal can show without moving its cursor: escapes for the rest; cut at LONGEST."""
    cut = text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in cut)


def natural(text: str) -> int | None:
    """The number that ASCII digits say; None for anything else, and for more than DIGITS."""
    if len(text) > DIGITS or not (text.isascii() and text.isdecimal()):
        return None
    return int(text)
