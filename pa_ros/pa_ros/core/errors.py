"""The root of every error that this project raises on purpose."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class PaError(Exception):
    """Rejected input. The message says what was wrong, what was expected and what to do.

    `code` names the kind of error ("program.unknown_word", "wire.non_finite"). Nodes count
    rejected messages by code and publish the counts in /diagnostics. A room has one class whose
    errors differ by code; it has more only where a caller catches them apart.
    """

    code = "error"

    def __init__(self, message: str = "", code: str = "") -> None:
        super().__init__(message)
        if code:
            self.code = code


class ConfigError(PaError):
    """A parameter, option or file that cannot be used; the message holds the value received."""

    code = "config"


@contextmanager
def needs_extra(extra: str, what: str) -> Iterator[None]:
    """Translate a failed import of an optional package; `what` begins the error's text."""
    try:
        yield
    except ImportError as error:
        raise ConfigError(
            f"{what}: expected the extra {extra} (`make install-{extra}`, or pip install "
            f'"programmable-agents[{extra}]"), got: {error}'
        ) from error
