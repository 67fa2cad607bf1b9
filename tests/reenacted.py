"""Everything that an arena did, made again by another one, to hold experience against."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from pa_ros.arena import ReachTask, world_of
from pa_ros.core.experience import Observation, Verdict
from pa_ros.world import Trajectory
from sim_node.session import Session


class Witness:
    """Notes what moved the arm of a session; its programs must be those of the episodes."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._world = world_of(session.arena, session.task.design)
        self._moves: dict[int, list[Any]] = {}  # velocities, by episode
        step, task = session.task.step, session.task

        def noted(velocity: Any) -> tuple[Observation, Verdict]:
            assert task.episode is not None
            self._moves.setdefault(task.episode.index, []).append(np.array(velocity))
            return step(velocity)

        task.step = noted  # type: ignore[assignment, method-assign]

    def false(self, trajectories: Iterable[Trajectory]) -> list[str]:
        """Transitions that never happened, by name."""
        happened = {episode: self._again(episode) for episode in self._moves}
        return [
            f"{one.key} {t}"
            for one in trajectories
            for t in range(len(one))
            if not self._happened(one, t, happened[one.episode])
        ]

    def _again(self, episode: int) -> list[tuple[Observation, Verdict]]:
        session = self._session
        task = ReachTask(session.arena, session.task.design, session.config.seed)
        return [task.reset(episode), *(task.step(move) for move in self._moves[episode])]

    def _happened(self, one: Trajectory, t: int, steps: list[tuple[Observation, Verdict]]) -> bool:
        first = one.first_step + t
        velocity = one.actions[t].astype(np.float64) * self._session.speed_limits
        before, (after, verdict) = steps[first][0], steps[first + 1]
        return (
            np.array_equal(velocity, self._moves[one.episode][first])
            and np.array_equal(one.objects[t], before.objects)
            and np.array_equal(one.arm[t], self._world.arm(before))
            and np.array_equal(one.objects[t + 1], after.objects)
            and np.array_equal(one.arm[t + 1], self._world.arm(after))
            and one.rewards[t] == np.float32(verdict.reward)
        )
