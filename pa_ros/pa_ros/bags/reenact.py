"""Recorded actions in a fresh arena: does it give what was recorded, to the last bit?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.core.experience import Observation, Stretch, Verdict
from pa_ros.wire.records import ArenaDescription


class Reenactment:
    """Re-enacts stretches of training episodes that were recorded from their first step."""

    def __init__(self, arena: ArenaDescription, condition: str = "train") -> None:
        """Raises ConfigError for a design or preset that is not known here."""
        preset = replace(preset_named(arena.preset), episode_steps=arena.episode_steps)
        design = replace(design_named(arena.design), n_blocks=arena.block_count)
        self.checked = 0  # transitions
        self.skipped = 0  # transitions of episodes whose beginning is not recorded
        self._task = ReachTask(preset, design, arena.seed)
        self._condition = condition
        self._speeds = np.array(arena.speed_limits)
        self._stands: tuple[int, int] | None = None  # episode and step
        self._observed: tuple[Observation, Verdict]

    def check(self, stretch: Stretch) -> str | None:
        """Name the first transition that the arena denies; None if all are right or skipped."""
        start = (stretch.episode, stretch.first_step)
        if stretch.first_step == 0:
            observation, verdict = self._task.reset(stretch.episode, self._condition)
        elif self._stands == start:
            observation, verdict = self._observed
        else:
            self.skipped += len(stretch)
            return None
        self._stands = None
        if stretch.program != self._task.program:
            observation, verdict = self._task.set_program(stretch.program)
        cause = _compare(stretch, 0, observation, None)
        if cause is not None:
            return _named(stretch, 0, cause)
        for t in range(len(stretch)):
            observation, verdict = self._task.step(
                stretch.actions[t].astype(np.float64) * self._speeds
            )
            self.checked += 1
            cause = _compare(stretch, t + 1, observation, verdict)
            if cause is not None:
                return _named(stretch, t, cause)
        self._observed = (observation, verdict)
        self._stands = (stretch.episode, observation.step)
        return None


def _compare(
    stretch: Stretch, row: int, observation: Observation, verdict: Verdict | None
) -> str | None:
    """What differs in a row; None if nothing does."""
    pairs = [
        ("objects", stretch.objects[row], observation.objects),
        ("arm", stretch.arm[row], observation.arm),
    ]
    for name, recorded, given in pairs:
        if recorded.shape != given.shape:
            return f"{name} of shape {recorded.shape} recorded, the arena gives {given.shape}"
        if not np.array_equal(recorded, given):
            where = tuple(int(i) for i in np.argwhere(recorded != given)[0])
            return f"{name}{list(where)} recorded {recorded[where]}, the arena gives {given[where]}"
    if verdict is not None and stretch.rewards[row - 1] != np.float32(verdict.reward):
        return f"reward {stretch.rewards[row - 1]} recorded, the arena gives {verdict.reward}"
    return None


def _named(stretch: Stretch, t: int, cause: str) -> str:
    return (
        f"transition {t} of stretch {stretch.sequence} of {stretch.agent_id} (episode "
        f"{stretch.episode}, step {stretch.first_step + t}): after the recorded action {cause}"
    )
