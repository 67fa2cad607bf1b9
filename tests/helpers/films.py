"""What films say."""

from __future__ import annotations

from typing import Any

import pytest


def captions(monkeypatch: pytest.MonkeyPatch, where: str) -> list[list[str]]:
    """The lines below each picture from now on; `where`: the function that would write them."""
    said: list[list[str]] = []

    def caption(picture: Any, lines: list[str]) -> Any:
        said.append(lines)
        return picture

    monkeypatch.setattr(where, caption)
    return said
