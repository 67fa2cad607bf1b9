"""Text that people read: made printable, with suggestions, as reports."""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from pa_ros.core.files import write_whole

if TYPE_CHECKING:
    from rich.console import Console

LONGEST = 1000  # characters shown

Report = Mapping[str, float | int | str]
"""Figures by dotted name, and strings that say how they were measured."""


def printable(text: str) -> str:
    """The text with everything escaped that could move a terminal's cursor; cut at LONGEST."""
    return _escaped(text if len(text) <= LONGEST else text[: LONGEST - 1] + "…")


def printable_lines(text: str) -> str:
    """Make several lines printable, like `printable`; lines stay lines, and nothing is cut."""
    return "\n".join(map(_escaped, text.split("\n")))


def renewable(console: Console) -> bool:
    """Whether the console can redraw lines in place: a terminal that is not a dumb one."""
    return console.is_terminal and not console.is_dumb_terminal


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name that was probably meant; None if no name is near."""
    names = list(known)
    last = name.lstrip("-").rpartition(".")[2]
    same = [one for one in names if one.lstrip("-").rpartition(".")[2] == last]
    return next(iter(same or difflib.get_close_matches(name, names, 1, cutoff=0.65)), None)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The end of an error about an unknown name, "; did you mean 'x'?"; empty if none is near."""
    near = nearest(name, known)
    return f"; did you mean {near!r}?" if near else ""


def write_report(path: Path | None, report: Report, without: str = "\0") -> None:
    """Print a report, a line a name, and write it as JSON to `path` if one is given.

    Names that begin with `without` are not printed.
    """
    shown = {name: value for name, value in report.items() if not name.startswith(without)}
    width = max(map(len, shown))
    for name, value in shown.items():
        print(f"{name:<{width}}  {f'{value:.6g}' if isinstance(value, float) else value}")
    if path is not None:
        write_whole(path, json.dumps({k: _json(v) for k, v in report.items()}, indent=2) + "\n")


def _json(value: float | int | str) -> float | int | str:
    """JSON has no NaN and no infinity: they become text."""
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _escaped(text: str) -> str:
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
