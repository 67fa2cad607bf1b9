"""Greedy episodes of a policy in an arena of its own, and the references beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from pa_ros.arena import ReachTask, random_policy, scripted_action
from pa_ros.core.experience import Float64, Observation
from pa_ros.evaluation.scores import EpisodeScore, normalized, rewards
from pa_ros.learning.actor import Actor

FIRST_EVALUATION_EPISODE = 1_000_000  # training episodes are numbered from 0

Policy = Callable[[ReachTask, Observation], Float64]
"""Joint velocities, rad/s [6], at an observation of a task."""


def greedy(actor: Actor) -> Policy:
    """The actor's action without exploration noise, scaled to the task's speed limits."""

    def act(task: ReachTask, observation: Observation) -> Float64:
        action = actor.act(observation, str(task.verifier.program))
        return action.astype(np.float64) * np.array(task.config.joint_speed_limits)

    return act


def scripted(task: ReachTask, observation: Observation) -> Float64:
    """The upper reference; privileged."""
    return scripted_action(task)


def uniform(seed: int) -> Policy:
    """The lower reference: random velocities, from a stream of its own."""
    policy = random_policy(seed)
    return lambda task, observation: policy(task)


def rollout(
    task: ReachTask, policy: Policy, episodes: Iterable[int], condition: str = "eval"
) -> list[EpisodeScore]:
    """Run one episode for each index under a condition and score it."""
    return [_episode(task, policy, index, condition) for index in episodes]


class Evaluator:
    """Scores an actor on the same episodes each time, raw and between the references.

    Per condition: `<condition>.reward_per_step`, `<condition>.normalized` (0 random, 1 scripted,
    on those episodes) and `<condition>.success_rate` (satisfied at the end of the episode).
    """

    def __init__(self, task: ReachTask, conditions: Sequence[str], episodes: int) -> None:
        self._task = task
        self._episodes = range(FIRST_EVALUATION_EPISODE, FIRST_EVALUATION_EPISODE + episodes)
        self._references = {
            condition: (self._mean(uniform(task.seed), condition), self._mean(scripted, condition))
            for condition in conditions
        }

    def __call__(self, actor: Actor) -> dict[str, float]:
        columns: dict[str, float] = {}
        for condition, (low, high) in self._references.items():
            scores = rollout(self._task, greedy(actor), self._episodes, condition)
            raw = float(rewards(scores).mean())
            columns[f"{condition}.reward_per_step"] = raw
            columns[f"{condition}.normalized"] = normalized(raw, low, high)
            columns[f"{condition}.success_rate"] = float(np.mean([s.success for s in scores]))
        return columns

    def _mean(self, policy: Policy, condition: str) -> float:
        return float(rewards(rollout(self._task, policy, self._episodes, condition)).mean())


def _episode(task: ReachTask, policy: Policy, index: int, condition: str) -> EpisodeScore:
    observation, verdict = task.reset(index, condition)
    program = str(task.verifier.program)
    received: list[float] = []
    while not verdict.truncated:
        observation, verdict = task.step(policy(task, observation))
        received.append(verdict.reward)
    return EpisodeScore(
        episode=index,
        program=program,
        reward_per_step=float(np.mean(received)),
        success=verdict.satisfied,
        distance=verdict.distance,
    )
