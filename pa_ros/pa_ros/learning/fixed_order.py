"""Several agents' trajectories in a fixed order: docs/DESIGN.md, "Several agents"."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from pa_ros.core.experience import AgentKey, TrajectoryKey
from pa_ros.learning.errors import LearningError
from pa_ros.learning.run import LearningRun
from pa_ros.world import Trajectory


class FixedOrder:
    """Holds trajectories back until the one before them in the order has arrived.

    Version v of the weights follows from agent (v − 1) mod N; a round is complete when N divides
    the version. Without agents there is no order: each trajectory is ready when it arrives.
    """

    def __init__(self, run: LearningRun, agents: Sequence[str] = ()) -> None:
        """`agents`: ids in their order."""
        self._run, self._agents = run, tuple(agents)
        self._held: dict[str, dict[TrajectoryKey, Trajectory]] = {name: {} for name in agents}

    def __len__(self) -> int:
        """Number of trajectories that are held back."""
        return sum(len(held) for held in self._held.values())

    @property
    def awaited(self) -> str:
        """The agent that the held trajectories wait for; empty: none is held."""
        return self._next_agent if len(self) else ""

    @property
    def round_complete(self) -> bool:
        """Whether weights are to be published now."""
        return not self._agents or self._run.learner.counters.version % len(self._agents) == 0

    def ready(self, trajectory: Trajectory) -> Iterator[Trajectory]:
        """Take in one trajectory. Yields those to learn from now; learn from each before the next.

        Raises LearningError for a trajectory that its agent cannot have sent, or an agent that has
        no place in the order.
        """
        self._run.check_sender(trajectory)
        if not self._agents:
            yield trajectory
            return
        held = self._held.get(trajectory.agent_id)
        if held is None:
            raise LearningError(
                f"trajectory: expected one of the agents {list(self._agents)}, which learn in this "
                f"order, got one of {trajectory.agent_id!r}",
                code="learning.turn",
            )
        if not self._run.learner.replay.ledger.is_new(trajectory.key):
            yield trajectory  # a duplicate needs no place in the order
            return
        for key in [key for key in held if key.incarnation != trajectory.incarnation]:
            del held[key]  # its agent has restarted
        held[trajectory.key] = trajectory
        while (following := self._next()) is not None:
            yield following

    @property
    def _next_agent(self) -> str:
        return self._agents[self._run.learner.counters.version % len(self._agents)]

    def _next(self) -> Trajectory | None:
        """The next trajectory in the order, if it has arrived."""
        held = self._held[self._next_agent]
        if not held:
            return None
        key = min(held)
        accounted = self._run.learner.replay.ledger.accounted().get(AgentKey(*key[:2]), 0)
        earliest = max(accounted, max(one.held_from for one in held.values()))
        return held.pop(key) if key.sequence <= earliest else None


def in_fixed_order(
    keys: Collection[TrajectoryKey], agents: Sequence[str], version: int
) -> list[TrajectoryKey]:
    """Keys in the fixed order, from a version on; those after a missing one are left out."""
    waiting = {name: sorted(key for key in keys if key.agent_id == name) for name in agents}
    order: list[TrajectoryKey] = []
    while waiting[name := agents[(version + len(order)) % len(agents)]]:
        order.append(waiting[name].pop(0))
    return order
