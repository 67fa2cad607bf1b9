"""How an agent and its learner meet in one process; over the graph, messages do the same."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from pa_ros.acting.agent import ArenaFacts
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.core.experience import AgentKey, PublishedPolicy
from pa_ros.learning.run import LearningRun
from pa_ros.world import Trajectory


def joined_agent(run: LearningRun, agent_id: str, seed: int) -> LearningAgent:
    """The run's only agent, which has received the learner's first weights.

    In a resumed run it continues where its learner's checkpoint was taken: with the same
    incarnation and the next trajectory number.
    """
    # Incarnation 0 and not a new one, so that equal runs leave equal checkpoints.
    key, sequence = AgentKey(agent_id, 0), 0
    for known, accounted in run.learner.replay.ledger.accounted().items():
        if known.agent_id == agent_id:
            key, sequence = known, accounted
    agent, info = LearningAgent(key, seed, sequence), run.info
    arena = ArenaFacts(info.world_digest, info.control_period, info.thresholds, info.reward)
    agent.follow(info, arena)
    for policy in run.opening():
        agent.offer(policy)
    return agent


class LearnerThread:
    """Takes trajectories to the learner in order, and the weights back (a context manager).

    With `overlap` the learner works on its own thread while the agent acts. Which weights act on
    which trajectory does not depend on that, so neither does the result.
    """

    def __init__(self, learn: Callable[[Trajectory], PublishedPolicy], overlap: bool) -> None:
        """`learn`: learns from one trajectory and returns the weights that it led to."""
        self._learn = learn
        self._results: deque[Callable[[], PublishedPolicy]] = deque()  # one per trajectory
        self._thread = ThreadPoolExecutor(1, "learner") if overlap else None

    def __enter__(self) -> LearnerThread:
        return self

    def __exit__(self, *_: object) -> None:
        if self._thread is not None:
            self._thread.shutdown(cancel_futures=True)

    def send(self, trajectory: Trajectory) -> None:
        """Learn from a trajectory: now, or on the thread as soon as the one before is done."""
        if self._thread is None:
            policy = self._learn(trajectory)
            self._results.append(lambda: policy)
        else:
            self._results.append(self._thread.submit(self._learn, trajectory).result)

    def receive(self) -> PublishedPolicy:
        """The weights that the next trajectory led to; waits for them."""
        return self._results.popleft()()

    def drain(self) -> None:
        """Wait until every trajectory is learned from: only then may the learner be read."""
        for result in self._results:
            result()
