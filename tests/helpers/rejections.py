"""Expecting an error by its code."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from pa_ros.core.errors import PaError


@contextmanager
def rejected(code: str, match: str | None = None) -> Iterator[pytest.ExceptionInfo[PaError]]:
    """Expect a PaError with this code whose text matches a regular expression."""
    with pytest.raises(PaError, match=match) as caught:
        yield caught
    assert caught.value.code == code
