"""Nodes that do what one alone should do, known by what they say of themselves in /diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable

from pa_ros.core.experience import AgentKey
from pa_ros.wire.diagnostics import Health

GONE_S = 2.5  # a node that says nothing for so long is gone; nodes speak once a second
INSTANCE, SPEAKS_ON = "instance", "speaks_on"  # keys of /diagnostics
REMEMBERED = 64
COMMANDED_S = 3.0  # agents that commanded within so long are at work


class Rivals:
    """The other processes that speak on a topic where one alone should."""

    def __init__(
        self, topic: str, instance: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """`topic`: its full name. `instance`: of this process, new at every start."""
        self._topic, self._instance, self._clock = topic, instance, clock
        self._heard: dict[str, tuple[str, float]] = {}  # instance → node, when

    @property
    def values(self) -> dict[str, str]:
        """What the others know this one by."""
        return {SPEAKS_ON: self._topic, INSTANCE: self._instance}

    def note(self, entry: Health) -> None:
        """Somebody says something of itself."""
        instance = entry.values.get(INSTANCE, "")
        if entry.values.get(SPEAKS_ON) == self._topic and instance not in ("", self._instance):
            self._heard[instance] = entry.name, self._clock()
            while len(self._heard) > REMEMBERED:
                del self._heard[next(iter(self._heard))]

    @property
    def alarm(self) -> str:
        """What a person should know and do; empty: there is none other."""
        since = self._clock() - GONE_S
        self._heard = {name: one for name, one in self._heard.items() if one[1] > since}
        if not self._heard:
            return ""
        others = ", ".join(f"{node} ({name})" for name, (node, _) in sorted(self._heard.items()))
        return (
            f"not alone on {self._topic}: {others}: stop all but one, or start each in a "
            "namespace of its own"
        )


class Commanders:
    """The agents whose commands an arena hears."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._heard: dict[AgentKey, float] = {}

    def note(self, agent: AgentKey) -> None:
        """A command of an agent has come, whatever became of it."""
        self._heard[agent] = self._clock()
        while len(self._heard) > REMEMBERED:
            del self._heard[min(self._heard, key=self._heard.__getitem__)]

    @property
    def alarm(self) -> str:
        """What a person should know and do; empty: there is one agent, or none."""
        since = self._clock() - COMMANDED_S
        self._heard = {agent: at for agent, at in self._heard.items() if at > since}
        if len(self._heard) < 2:
            return ""
        names = ", ".join(sorted(agent.agent_id for agent in self._heard))
        return f"several command the arm ({names}): stop all but one agent_node"
