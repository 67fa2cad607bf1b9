"""Everything that an arena did, made again by another one, to hold experience against."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from pa_ros.arena import ReachTask, world_of
from pa_ros.arena.designs import Kind
from pa_ros.arena.verifier import Verifier
from pa_ros.core.experience import Observation
from pa_ros.world import Trajectory
from sim_node.session import Session


class Witness:
    """Notes what moved the arm of a session."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._world = world_of(session.arena, session.task.design)
        self._moves: dict[int, list[Any]] = {}  # velocities, by episode
        self._kinds: dict[int, list[Kind]] = {}  # of the blocks, by episode
        advance, task = session.task.advance, session.task

        def noted(joint_velocity: Any) -> Observation:
            assert task.episode is not None
            self._moves.setdefault(task.episode.index, []).append(np.array(joint_velocity))
            self._kinds[task.episode.index] = [block.kind for block in task.episode.blocks]
            return advance(joint_velocity)

        task.advance = noted  # type: ignore[method-assign]

    def false(self, trajectories: Iterable[Trajectory]) -> list[str]:
        """Transitions that never happened, by name."""
        happened = {episode: self._again(episode) for episode in self._moves}
        return [
            f"{one.key} {t}"
            for one in trajectories
            for t in range(len(one))
            if not self._happened(one, t, happened[one.episode])
        ]

    def _again(self, episode: int) -> list[Observation]:
        session = self._session
        task = ReachTask(session.arena, session.task.design, session.config.seed)
        first, _ = task.reset(episode)
        return [first, *(task.step(move)[0] for move in self._moves[episode])]

    def _happened(self, one: Trajectory, t: int, steps: list[Observation]) -> bool:
        first = one.first_step + t
        velocity = one.actions[t].astype(np.float64) * self._session.speed_limits
        before, after = steps[first], steps[first + 1]
        # a program that someone sent, another arena even, may be in force
        verifier = Verifier(one.program, self._kinds[one.episode], self._session.task.scoring)
        return (
            np.array_equal(velocity, self._moves[one.episode][first])
            and np.array_equal(one.objects[t], before.objects)
            and np.array_equal(one.arm[t], self._world.arm(before))
            and np.array_equal(one.objects[t + 1], after.objects)
            and np.array_equal(one.arm[t + 1], self._world.arm(after))
            and one.rewards[t] == np.float32(verifier.score(after.objects, after.hand_pose).reward)
        )
