"""What pages ask for: viser checks types alone, so that a value may be none of those offered."""

from __future__ import annotations

from collections.abc import Callable

from pa_ros.core.errors import PaError
from pa_ros.ros.refusals import Refusals


class PageError(PaError):
    """What a page asked for cannot be done."""

    code = "console.page"


def attempt(refusals: Refusals, what: str, act: Callable[[], object]) -> None:
    """Do what a page asked for; whatever is raised is refused: the other pages go on."""
    try:
        act()
    except PaError as error:
        refusals.refuse(what, error)
    except Exception as error:
        refusals.refuse(what, PageError(f"{type(error).__name__}: {error}"))
