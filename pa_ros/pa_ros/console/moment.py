"""One control step as the page shows it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import nan

from pa_ros.acting.insight import Explanation
from pa_ros.bags.episodes import Row
from pa_ros.core.experience import Observation
from pa_ros.wire.arena import ArenaDescription


@dataclass(frozen=True)
class Moment:
    """One control step as the page shows it, from a running graph or from a bag."""

    arena: ArenaDescription
    observation: Observation
    evaluation: bool
    program: str  # canonical text in force; empty: none, or not known
    reward: float = nan
    distance: float = nan  # m; for other relations than NEAR, their own measure
    satisfied: bool | None = None  # None: not recorded
    explanation: Explanation | None = None  # None: no weights, or none that fit
    unexplained: str = ""  # why there is no explanation
    stage: int = 0  # of a goal over time: which of its programs is pursued

    @property
    def verdict(self) -> str:
        """Whether the program is satisfied, in words."""
        return {True: "satisfied", False: "not yet", None: "not recorded"}[self.satisfied]

    @property
    def row(self) -> Row:
        """The same as a row of a recording."""
        return replace(Row.of(self.observation, self.program), stage=self.stage)

    @property
    def blocks(self) -> list[int]:
        """Rows of the observation's objects that are blocks."""
        seen = self.observation
        return [i for i in range(len(seen.objects)) if i != seen.hand_index]

    @property
    def names(self) -> list[str]:
        """The blocks' words, or "block 1" where nobody tells them."""
        seen = self.observation
        labels = self.arena.world.schema.labels(seen.objects, seen.hand_index)
        return [labels[i] for i in self.blocks]
