"""Whether formulas of temporal logic hold on the hand's way, at the end of every physics step.

Verdicts are made once in a control period, and goals ask for more than their formulas. Here the
formula itself is judged, for an agent as for the straight line.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pa_ros.arena import ReachTask, play
from pa_ros.arena.zones import FormulaEpisode
from pa_ros.evaluation.evaluate import AgentPolicy, pursuing, reference_policy
from pa_ros.language.ltl import holds, parse_ltl
from pa_ros.language.syntax import NEAR


@dataclass(frozen=True, slots=True)
class Traces:
    """Shares of the episodes of a condition."""

    condition: str
    episodes: int
    success_rate: float  # the formula holds
    straight_line_rate: float  # likewise of the script, which avoids nothing
    violations: float  # the episode ended because its goal was violated


def traces(
    task: ReachTask,
    policy: AgentPolicy | str,
    condition: str,
    episodes: int,
    straight: float | None = None,
) -> Traces:
    """Play a policy and the straight line in episodes 0 … episodes − 1 of a condition.

    `straight`: the straight line's share, where it is known.
    """
    own = np.mean([*_played(task, policy, condition, episodes)], axis=0)
    if straight is None:
        straight = np.mean([*_played(task, "scripted", condition, episodes)], axis=0)[0]
    return Traces(condition, episodes, float(own[0]), float(straight), float(own[1]))


def _played(
    task: ReachTask, policy: AgentPolicy | str, condition: str, episodes: int
) -> Iterator[tuple[bool, bool]]:
    """Of each episode, which ends once its goal holds or is violated: whether the formula holds,
    and whether the goal is violated."""
    act = reference_policy(task, policy) if isinstance(policy, str) else pursuing(task, policy)
    for index in range(episodes):
        start = task.reset(index, condition)
        zones = task.simulation.positions[1:]
        way = task.simulation.way = [task.simulation.positions[0]]
        for _, verdict in play(task, act, start):
            if verdict.satisfied or verdict.violated:
                break
        task.simulation.way = None
        away = np.linalg.norm(np.array(way)[:, None] - zones, axis=-1)  # [steps, zones]
        near = away <= task.scoring.threshold(NEAR)
        words = [block.kind.words for block in task.episode.blocks]
        states = [frozenset().union(*(words[i] for i in np.flatnonzero(row))) for row in near]
        assert isinstance(task.episode, FormulaEpisode)
        formula = parse_ltl(task.episode.formula, task.design.vocabulary)
        yield holds(formula, states), verdict.violated
