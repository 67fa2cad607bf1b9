"""The account of what agents send and a learner learns, as an outsider keeps it."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from pa_ros.core.experience import AgentKey


class Ledger:
    """Of all agents ever heard, and of the learner's newest weights."""

    def __init__(self) -> None:
        self.version = 0
        self._accounted: dict[AgentKey, int] = {}  # by those weights: all before this sequence
        self._ever: dict[AgentKey, int] = {}  # by any: a learner may begin again from before
        # One more than the highest number heard: who listens to a newcomer is found by it one after
        # the other, and we may not be the first.
        self._published: dict[AgentKey, int] = {}

    def sent(self, agent: AgentKey, sequence: int) -> None:
        """A trajectory of an agent was heard."""
        self._published[agent] = max(self._published.get(agent, 0), sequence + 1)

    def learned(self, version: int, accounted: Mapping[AgentKey, int]) -> None:
        """Weights were published. Of an agent that came back under its name they say nothing of
        its former incarnation: what was said of that stands."""
        self.version = version
        self._accounted |= accounted
        for agent, count in accounted.items():
            self._ever[agent] = max(self._ever.get(agent, 0), count)

    def unexplained(self, living: Collection[str], told: int) -> int:
        """Trajectories sent that are neither learned, nor among the `told` ones, which were
        refused or reported lost, nor under way from an agent whose name is among the `living`.

        What a dead agent had sent, and a learner had learned before it was killed, is no loss
        beyond that of the learner's newest checkpoint. Negative if more was learned than sent.
        """
        accounted = lost = 0
        for agent, heard in self._published.items():
            ever = self._ever.get(agent, 0)
            dead = agent.agent_id not in living
            # A trajectory that was being sent when its agent was killed: some hear it, some don't.
            sent = heard + (dead and ever > heard)
            accounted += min(self._accounted.get(agent, 0), sent)
            lost += max(0, sent - ever) if dead else 0
        return accounted - self.version - told + lost
