"""Several agents' trajectories in a fixed order: docs/DESIGN.md, "Several agents in step"."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from pa_ros.core.experience import AgentKey, TrajectoryKey
from pa_ros.learning.errors import LearningError
from pa_ros.learning.run import LearningRun
from pa_ros.world import Trajectory


class Turns:
    """Holds trajectories until it is their agent's turn, and the one before has come.

    Version v of the weights is led to by agent (v − 1) mod N; a round is over where N divides the
    version. Without agents there are no turns: each trajectory is ready as it comes.
    """

    def __init__(self, run: LearningRun, agents: Sequence[str] = ()) -> None:
        """`agents`: by name, in their order."""
        self._run, self._agents = run, tuple(agents)
        self._held: dict[str, dict[TrajectoryKey, Trajectory]] = {name: {} for name in agents}

    def __len__(self) -> int:
        """Trajectories that wait for their turn."""
        return sum(len(held) for held in self._held.values())

    @property
    def awaited(self) -> str:
        """The agent whose turn it is while another's trajectories wait; empty: none do."""
        return self._turn if len(self) else ""

    @property
    def over(self) -> bool:
        """Whether a round is over: weights are published now."""
        return not self._agents or self._run.learner.counters.version % len(self._agents) == 0

    def ready(self, trajectory: Trajectory) -> Iterator[Trajectory]:
        """Take one in; what can now be learned from, each to be consumed before the next is asked.

        Raises LearningError for an agent without a turn, LearningError, LearningError.
        """
        if self._hold(trajectory):
            while (following := self._next()) is not None:
                yield following
        else:
            yield trajectory

    @property
    def _turn(self) -> str:
        return self._agents[self._run.learner.counters.version % len(self._agents)]

    def _hold(self, trajectory: Trajectory) -> bool:
        """Keep it until its turn; False: it need not wait, or is here already."""
        if not self._agents:
            return False
        held = self._held.get(trajectory.agent_id)
        if held is None:
            raise LearningError(
                f"trajectory: expected one of the agents {list(self._agents)}, which have turns, "
                f"got one of {trajectory.agent_id!r}",
                code="learning.turn",
            )
        self._run.check(trajectory)
        if not self._run.learner.replay.ledger.is_new(trajectory.key):
            return False
        for key in [key for key in held if key.incarnation < trajectory.incarnation]:
            del held[key]  # its agent has started again
        held[trajectory.key] = trajectory
        return True

    def _next(self) -> Trajectory | None:
        held = self._held[self._turn]
        if not held:
            return None
        key = min(held)
        first = self._run.learner.replay.ledger.accounted().get(AgentKey(*key[:2]), 0)
        awaited = key.sequence > max(first, max(one.held_from for one in held.values()))
        return None if awaited else held.pop(key)


def in_turn(
    keys: Collection[TrajectoryKey], agents: Sequence[str], version: int
) -> list[TrajectoryKey]:
    """Keys in the order of their turns, from a version on; others are left out."""
    waiting = {name: sorted(key for key in keys if key.agent_id == name) for name in agents}
    order: list[TrajectoryKey] = []
    while waiting[name := agents[(version + len(order)) % len(agents)]]:
        order.append(waiting[name].pop(0))
    return order
