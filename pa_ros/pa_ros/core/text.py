"""Text from outside, of which nothing is known, and where it is shown."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

LONGEST = 1000  # characters shown
DIGITS = 18  # of the greatest number that is read


def printable(text: str) -> str:
    """What a terminal can show without moving its cursor: escapes for the rest; cut at LONGEST."""
    return _escaped(text if len(text) <= LONGEST else text[: LONGEST - 1] + "…")


def printable_lines(text: str) -> str:
    """The same of several lines, which they stay; nothing is cut."""
    return "\n".join(map(_escaped, text.split("\n")))


def renewable(console: Console) -> bool:
    """Whether what is shown can be renewed in place: by a terminal, if it isn't a dumb one."""
    return console.is_terminal and not console.is_dumb_terminal


def natural(text: str) -> int | None:
    """The number that ASCII digits say; None for anything else, and for more than DIGITS."""
    if len(text) > DIGITS or not (text.isascii() and text.isdecimal()):
        return None
    return int(text)


def _escaped(text: str) -> str:
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
