"""Errors of the arena on the graph."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class SimError(PaError):
    """A message or request that the arena rejects; `code` says why."""


class SimulatorError(SimError):
    """A rejected request of the standard simulator's services; `result` is the standard's code."""

    def __init__(self, text: str, result: int) -> None:
        super().__init__(text, code="arena.request")
        self.result = int(result)
