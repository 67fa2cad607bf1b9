"""What a learner is doing, or waits for, in words that a person can act on."""

from __future__ import annotations

import time
from collections.abc import Callable

from pa_ros.core.experience import AgentKey
from pa_ros.ros import topics
from pa_ros.ros.health import ERROR, OK, WARN

IDLE_S = 2.0  # without a trajectory for so long, it waits for one, unless they come as seldom
PATIENCE = 3.0  # times the usual time between trajectories
AT_WORK_S = 10.0  # agents heard within so long may still send what is missing
REFUSED_S = 3.0  # a refusal is worth a word for so long


class Watch:
    """Remembers what came when."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._came_at = self._advanced_at = clock()
        self._frames = -1.0
        self._usual_s = 0.0  # between trajectories, smoothed
        self._any = False
        self._agents: dict[AgentKey, float] = {}
        self._heard: dict[str, tuple[float, float]] = {}  # by name: when last; s between
        self._refusal, self._refused_at = "", 0.0

    def came(self, agent: AgentKey) -> None:
        """A trajectory that can be read has come."""
        now = self._clock()
        if self._any:
            self._usual_s += 0.2 * (now - self._came_at - self._usual_s)
        self._any, self._came_at = True, now
        self._agents = {name: at for name, at in self._agents.items() if now - at < AT_WORK_S}
        self._agents[agent] = now
        before, usual_s = self._heard.get(agent.agent_id, (now, 0.0))
        since_s = now - before
        smoothed_s = usual_s + 0.2 * (since_s - usual_s) if usual_s else since_s
        self._heard[agent.agent_id] = now, smoothed_s

    def refused(self, reason: str) -> None:
        """Something was refused; `reason`: what, and why."""
        self._refusal, self._refused_at = reason, self._clock()

    def at_work(self, agent: AgentKey) -> bool:
        """Whether an agent was heard lately."""
        return self._clock() - self._agents.get(agent, -AT_WORK_S) < AT_WORK_S

    def state(
        self, trouble: str, missing: int, backlog: int, frames: float, awaited: str = ""
    ) -> tuple[int, str]:
        """Level and message of a learner that has an arena. `missing`: of agents at work;
        `awaited`: for whose trajectory others' wait."""
        now, name = self._clock(), topics.TRAJECTORIES.name
        if frames != self._frames:
            self._frames, self._advanced_at = frames, now
        idle_s, still_s = now - self._came_at, now - self._advanced_at
        patience_s = max(IDLE_S, PATIENCE * self._usual_s)
        if trouble:
            return ERROR, trouble
        if self._refusal and now - self._refused_at < REFUSED_S:
            return WARN, f"refuses {self._refusal}"
        if not self._any:
            return WARN, (
                f"waits for an agent that learns ({name}): does agent_node run, with the "
                "parameter learning?"
            )
        if awaited and still_s > patience_s:
            return WARN, (
                f"waits for {awaited!r}, whose turn it is, and all others wait with it "
                "(learner.schedule.in_step=exact): do its sim_node and agent_node run?"
            )
        if not backlog and idle_s > patience_s:
            return WARN, f"no trajectory for {idle_s:.0f} s: do sim_node and agent_node run?"
        if not backlog and still_s > patience_s:
            return WARN, (
                f"trajectories come, and all for {still_s:.0f} s were here before: does someone "
                "else send under an agent's name?"
            )
        if missing:
            return WARN, f"{missing} trajectories are missing: their agent sends them again"
        return self._silent(now) or (OK, "learning")

    def _silent(self, now: float) -> tuple[int, str] | None:
        """Of several agents one that is not heard any more; it is forgotten after a while."""
        for name, (at, usual_s) in list(self._heard.items()):
            silent_s, patience_s = now - at, max(IDLE_S, PATIENCE * usual_s)
            if silent_s > patience_s + AT_WORK_S:
                del self._heard[name]
            elif usual_s and silent_s > patience_s and len(self._heard) > 1:
                return WARN, (
                    f"no trajectory of {name!r} for {silent_s:.0f} s, the others' are learned "
                    "from: do its sim_node and agent_node run?"
                )
        return None
