"""What an arm learns next without resets: an episode begins where the last one ended. No ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np

from pa_ros.arena import Design, Kind, training_programs
from pa_ros.arena.simulation import HAND_INDEX
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Verdict
from pa_ros.language import Program, parse, require_possible
from pa_ros.language.errors import ProgramError
from sim_node.robot.settings import LessonSettings

RECENT = 2000  # steps that the reported shares are over: 200 s


class Lessons:
    """The training programs, in random order, and when a person is to scatter the blocks."""

    def __init__(
        self, settings: LessonSettings, design: Design, kinds: Sequence[Kind], period_s: float
    ) -> None:
        """`kinds`: of all objects in robot.yaml; `period_s`: of control.

        Raises ProgramError for a program that cannot be read, ConfigError if none is left.
        """
        words = [(), *(tuple(kind.values()) for kind in kinds)]
        given = [parse(text, design.vocabulary) for text in settings.programs]
        self.programs = tuple(
            program
            for program in given or training_programs(design)
            if _is_possible(program, words, design)
        )
        if not self.programs:
            raise ConfigError("learning.programs: expected one that names an object, got none")
        self.held_out = tuple(
            str(kind) for kind in kinds if not any(kind.words <= {*p.words} for p in self.programs)
        )
        self.blocks = settings.blocks or len(kinds)  # on the table at once
        self.episode_steps = max(round(settings.episode_s / period_s), 1)
        self._every = round(settings.scatter_every_min * 60 / period_s)  # steps; 0: never
        self._rng = np.random.default_rng(settings.seed)
        self.scatters = -1  # without the first time
        self._steps = 0  # since the blocks were scattered
        self._rewards = deque[float](maxlen=RECENT)
        self._held = deque[bool](maxlen=RECENT)

    def order(self) -> Iterator[Program]:
        """The training programs, in a new random order."""
        return (self.programs[i] for i in self._rng.permutation(len(self.programs)))

    def scattered(self) -> None:
        """A person has put the blocks where they are now."""
        self.scatters, self._steps = self.scatters + 1, 0

    def count(self, verdict: Verdict, held: bool) -> None:
        """Count a control step; `held`: the arm did not do as commanded."""
        self._steps += 1
        self._rewards.append(verdict.reward)
        self._held.append(held)

    @property
    def scatter_is_due(self) -> bool:
        """Whether a person is to scatter the blocks before the next episode."""
        return 0 < self._every <= self._steps

    def report(self) -> dict[str, str]:
        """What a person watches, for /diagnostics."""
        left = max(self._every - self._steps, 0) if self._every else None
        minutes = {} if left is None else {"steps_to_scatter": str(left)}
        if not self._rewards:
            return minutes
        return {
            "reward_per_step": f"{np.mean(self._rewards):.3f}",
            "held_share": f"{np.mean(self._held):.3f}",
            "scatters": str(self.scatters),
            **minutes,
        }


def _is_possible(program: Program, words: Sequence[tuple[str, ...]], design: Design) -> bool:
    try:
        require_possible(program, words, HAND_INDEX, design.schema.bodiless)
    except ProgramError:
        return False
    return True
