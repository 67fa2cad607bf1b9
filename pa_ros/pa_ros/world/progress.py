"""Verdicts on a goal over time, state by state, from scores of its programs."""

from __future__ import annotations

from collections.abc import Callable

from pa_ros.core.experience import Verdict
from pa_ros.language import Goal, Program, Progress, stages
from pa_ros.world.reward import Reward
from pa_ros.world.scoring import Score


class GoalWatch:
    """Follows one goal over consecutive states. The arena feeds it scores of the true state; an
    agent that hears no verifier, those of its own estimate."""

    def __init__(self, goal: Goal) -> None:
        self.goal = goal
        self.stages = stages(goal)
        self._progress = Progress.of(goal)

    @property
    def program(self) -> Program:
        """The program that is to be pursued now."""
        return self.stages[self._progress.stage]

    def verdict(
        self, score: Callable[[Program], Score], reward: Reward, truncated: bool = False
    ) -> Verdict:
        """Take in the next state; `score` gives that of a program that avoids nothing.

        The measure is that of the program to be pursued, the rest is of the whole goal.
        """
        goal = self.goal
        if isinstance(goal, Program) and goal.avoided is None:
            now = score(goal)
            return Verdict(float(now.reward), bool(now.satisfied), float(now.measure), truncated)
        known: dict[Program, Score] = {}

        def once(program: Program) -> Score:
            if program not in known:
                known[program] = score(program)
            return known[program]

        self._progress = progress = self._progress.after(lambda p: bool(once(p).satisfied))
        measure = float(once(self.program.relation_alone).measure)
        given = float(reward(progress.holds, measure))
        at = progress.stage, progress.violated
        return Verdict(given, progress.holds, measure, truncated, *at)
