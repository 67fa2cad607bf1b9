"""Skills: what the programs of a design do. Each is declared in a file of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, ClassVar

from pa_ros.core.registry import Registry

if TYPE_CHECKING:  # they look up the skill of a design
    import numpy as np

    from pa_ros.arena.conditions import Condition
    from pa_ros.arena.config import ArenaConfig
    from pa_ros.arena.designs import Design, Kind
    from pa_ros.arena.episodes import Episode
    from pa_ros.arena.task import ReachTask
    from pa_ros.core.experience import Float64
    from pa_ros.language import Program

NORMALIZED, SUCCESS = "normalized", "success_rate"
"""How agents are judged: by their reward, 0 for a random policy and 1 for the script, or by the
share of episodes at whose end the program is satisfied."""


@dataclass(frozen=True)
class DemoProgram:
    """A program that shows what an agent learned, and what is new about it."""

    kind: str
    text: str
    targets: int = 1  # objects of the scene that it names
    farthest: float = inf  # from holding, at the start, in the unit of its relation
    steps: int = 60  # that it may take


class Skill(ABC):
    """What the programs of a design do, how their episodes are drawn, and who executes them best.

    Register one in SKILLS, and name it in a `Design`.
    """

    preset: ClassVar[str] = "fast"
    """The arena's preset, unless another one is chosen."""
    touches_blocks: ClassVar[bool] = False
    """Whether the arm has to touch blocks."""
    holds_blocks: ClassVar[bool] = False
    """Whether it has to hold them."""
    does: ClassVar[str]
    """What an agent does and does not, in words that follow "It"."""
    score: ClassVar[str] = NORMALIZED
    """NORMALIZED or SUCCESS."""
    demo_conditions: ClassVar[tuple[str, str]]
    """Conditions of scenes to show: as in training; and with fewer blocks of one color."""

    @abstractmethod
    def training_programs(self, design: Design) -> tuple[Program, ...]:
        """The programs of training episodes."""

    @abstractmethod
    def conditions(self, design: Design) -> Iterable[Condition]:
        """The conditions of a design; `train` is one of them."""

    @abstractmethod
    def draw(
        self,
        config: ArenaConfig,
        design: Design,
        condition: Condition,
        index: int,
        rng: np.random.Generator,
    ) -> Episode:
        """Draw an episode; ArenaError (arena.episode) if its blocks do not fit on the table."""

    @abstractmethod
    def script(self, task: ReachTask) -> Float64:
        """Joint velocities (rad/s, [J]) of the reference that knows the true state."""

    @abstractmethod
    def demo(self, design: Design) -> list[DemoProgram]:
        """Programs to show, of the design's first relation: one trained, the others not."""


SKILLS: Registry[Skill] = Registry("skill")


def two_alike(kinds: Iterable[Kind], group: str) -> tuple[Kind, Kind]:
    """The first block, and the next one with the same value of a group."""
    known, *others = kinds
    return known, next(kind for kind in others if kind[group] == known[group])
