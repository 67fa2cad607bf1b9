"""Recorded actions in a fresh arena: does it give what was recorded, to the last bit?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.core.experience import Observation, Verdict
from pa_ros.wire.arena import ArenaDescription
from pa_ros.world import Trajectory, reward_from


class Reenactment:
    """Re-enacts trajectories of training episodes that were recorded from their first step."""

    def __init__(
        self, arena: ArenaDescription, condition: str = "train", blocks: int | None = None
    ) -> None:
        """`blocks`: that the arena was asked for, 0: the design's; None: as it has described.

        Raises ConfigError for a design, arm or preset that is not known here.
        """
        preset = preset_named(arena.preset, arena.arm).changed(
            episode_steps=arena.episode_steps, thresholds=arena.thresholds
        )
        design = design_named(arena.design).with_relations(*arena.world.relations)
        count = arena.block_count if blocks is None else blocks or design.n_blocks
        design = replace(design, n_blocks=count)
        self.checked = 0  # transitions
        self.skipped = 0  # transitions of episodes whose beginning is not recorded
        self._task = ReachTask(preset, design, arena.seed, reward=reward_from(arena.reward))
        self._condition = condition
        self._speeds = np.array(arena.speed_limits)
        self._stands: tuple[int, int] | None = None  # episode and step
        self._denied: int | None = None  # episode that is not what the arena gives
        self._observed: tuple[Observation, Verdict]

    def check(self, trajectory: Trajectory) -> str | None:
        """Name the first transition that the arena denies; None if all are right or skipped."""
        start = (trajectory.episode, trajectory.first_step)
        if trajectory.first_step == 0:
            observation, verdict = self._task.reset(trajectory.episode, self._condition)
        elif self._stands == start:
            observation, verdict = self._observed
        else:
            self.skipped += 0 if trajectory.episode == self._denied else len(trajectory)
            return None
        self._stands = self._denied = None
        if trajectory.program != self._task.program:
            observation, verdict = self._task.set_program(trajectory.program)
        cause = self._compare(trajectory, 0, observation, None)
        if cause is not None:
            return self._deny(trajectory, 0, cause)
        for t in range(len(trajectory)):
            observation, verdict = self._task.step(
                trajectory.actions[t].astype(np.float64) * self._speeds
            )
            self.checked += 1
            cause = self._compare(trajectory, t + 1, observation, verdict)
            if cause is not None:
                return self._deny(trajectory, t, cause)
        self._observed = (observation, verdict)
        self._stands = (trajectory.episode, observation.step)
        return None

    def _deny(self, trajectory: Trajectory, t: int, cause: str) -> str:
        """The transition's name and what is wrong with it; its episode ends here."""
        self._denied = trajectory.episode
        return (
            f"transition {t} of trajectory {trajectory.sequence} of {trajectory.agent_id} "
            f"(episode {trajectory.episode}, step {trajectory.first_step + t}): "
            f"after the recorded action {cause}"
        )

    def _compare(
        self, trajectory: Trajectory, row: int, observation: Observation, verdict: Verdict | None
    ) -> str | None:
        """What differs in a row; None if nothing does."""
        pairs = [
            ("objects", trajectory.objects[row], observation.objects),
            ("arm", trajectory.arm[row], self._task.world.arm(observation)),
        ]
        for name, recorded, given in pairs:
            if recorded.shape != given.shape:
                return f"{name} of shape {recorded.shape} recorded, the arena gives {given.shape}"
            if not np.array_equal(recorded, given):
                where = tuple(int(i) for i in np.argwhere(recorded != given)[0])
                found = f"recorded {recorded[where]}, the arena gives {given[where]}"
                return f"{name}{list(where)} {found}"
        if verdict is not None and trajectory.rewards[row - 1] != np.float32(verdict.reward):
            return (
                f"reward {trajectory.rewards[row - 1]} recorded, the arena gives {verdict.reward}"
            )
        return None
