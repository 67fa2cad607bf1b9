"""An agent and the arena that does as it says, in one process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from helpers.learners import ARENA, DESIGN, FACTS, LEARNER, ME, published
from pa_ros.acting.agent import Agent, Step
from pa_ros.acting.answer import Act, Wait
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.arena import ReachTask
from pa_ros.core.experience import Executed, Observation, Verdict
from pa_ros.core.published import LearnerInfo
from pa_ros.world import Trajectory

FAR_BEHIND = replace(LEARNER, policy_lag=10**6)  # never waited for


Says = Callable[[Executed], Executed | None]


def as_sent(sent: Executed) -> Executed | None:
    return Executed(sent.command, sent.action.copy())


class Arm:
    """An arena that does as the agent says, unless told otherwise."""

    def __init__(self, agent: Agent) -> None:
        self.agent: Any = agent  # a LearningAgent, where the test says so
        self.task = ReachTask(ARENA, DESIGN, seed=1)
        self.sent: list[Trajectory] = []
        self.velocity = np.zeros(6)

    def show(
        self,
        observation: Observation,
        verdict: Verdict,
        executed: Executed | None,
        evaluation: bool = False,
    ) -> None:
        step = Step(observation, self.task.program, verdict, evaluation, executed)
        trajectory = self.agent.observe(step)
        if trajectory is not None:
            self.sent.append(trajectory)
        self.velocity = np.zeros(6)
        while not isinstance(answer := self.agent.answer(), Wait):
            if isinstance(answer, Act):
                self.velocity = self.agent.act().astype(np.float64)
                return
            self.agent.load(answer.policy)

    def reset(self, episode: int, evaluation: bool = False) -> None:
        condition = "eval" if evaluation else "train"
        self.show(*self.task.reset(episode, condition), None, evaluation=evaluation)

    def run(self, steps: int, says: Says = as_sent, evaluation: bool = False) -> None:
        """`says`: what the arena says it has carried out, of what the agent sent."""
        for _ in range(steps):
            executed = says(self.agent.sent)
            self.show(*self.task.step(self.velocity), executed, evaluation=evaluation)

    @property
    def spans(self) -> list[tuple[int, int, int]]:
        """(sequence, first step, length) of the trajectories sent."""
        return [(one.sequence, one.first_step, len(one)) for one in self.sent]


def following(learner: LearnerInfo = FAR_BEHIND) -> LearningAgent:
    agent = LearningAgent(ME, seed=0)
    agent.follow(learner, FACTS)
    agent.offer(published(learner.first_version, learner=learner))
    return agent
