"""Several things to be done, of which some fail: the others are done all the same."""

from __future__ import annotations

from collections.abc import Mapping

from pa_ros.core.errors import PaError


class FailedError(PaError):
    """Some of what was to be done was refused, or diverged; all the rest is done."""

    code = "evaluation.failed"


def check_failures(failures: Mapping[str, PaError]) -> None:
    """Raise FailedError if there are any, by what was to be done."""
    if failures:
        what = "; ".join(f"{name}: {error}" for name, error in failures.items())
        raise FailedError(f"expected all to end well, but for {what}")
