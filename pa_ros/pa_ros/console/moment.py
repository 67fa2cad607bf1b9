"""One control step as the page shows it."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

from pa_ros.acting.insight import Explanation
from pa_ros.tools.scenes import Scene


@dataclass(frozen=True)
class Moment(Scene):
    """A scene of a running graph or of a bag, explained by the weights that acted in it."""

    reward: float = nan  # recorded transitions tell it without a verdict
    explanation: Explanation | None = None  # None: no weights, or none that fit
    unexplained: str = ""  # why there is no explanation

    @property
    def verdict(self) -> str:
        """Whether the program is satisfied, in words."""
        if self.step.verdict is None:
            return "not recorded"
        return "satisfied" if self.satisfied else "not yet"

    @property
    def block_rows(self) -> list[int]:
        """Rows of the observation's objects that are blocks."""
        seen = self.observation
        return [i for i in range(len(seen.objects)) if i != seen.hand_index]
