"""One control step as the page shows it, heard from a graph or read from a bag."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

from pa_ros.bags.episodes import Row
from pa_ros.console.insight import Insight, Look
from pa_ros.core.errors import PaError
from pa_ros.core.experience import Observation
from pa_ros.language import Vocabulary, parse
from pa_ros.wire.arena import ArenaDescription


@dataclass(frozen=True)
class Moment:
    """An observation, what was to be done, and how the arena judged it."""

    arena: ArenaDescription
    observation: Observation
    evaluation: bool
    program: str  # canonical text in force; empty: none, or it isn't known
    reward: float = nan
    distance: float = nan  # m; of another relation than NEAR, its measure
    satisfied: bool | None = None  # None: not recorded
    look: Look | None = None  # None: no weights, or none that fit
    why_blind: str = ""  # why there is no look

    @property
    def row(self) -> Row:
        """As a recording has it."""
        seen = self.observation
        return Row(
            seen.step,
            seen.stamp_ns,
            seen.objects,
            seen.hand_index,
            self.program,
            joint_position=seen.joint_position,
            joint_velocity=seen.joint_velocity,
        )


def looked(
    insight: Insight | None, observation: Observation, text: str, vocabulary: Vocabulary
) -> tuple[Look | None, str]:
    """What the networks make of a moment; or why nothing can be said."""
    if insight is None:
        return None, "no weights are known here"
    try:
        program = parse(text, vocabulary) if text else None
        return insight.look(observation, program), ""
    except (PaError, RuntimeError) as error:  # torch: another world's features
        return None, str(error).partition("\n")[0]
