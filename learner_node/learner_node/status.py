"""What a learner is doing or waiting for, in words that a person can act on."""

from __future__ import annotations

import time
from collections.abc import Callable

from pa_ros.ros.health import ERROR, OK, WARN

IDLE_S = 2.0  # an agent is silent after so long without a trajectory, or after PATIENCE times
PATIENCE = 3.0  # its usual time between two: in real time an episode takes 10 s
AT_WORK_S = 10.0  # an agent that was silent for so long has left
REFUSED_S = 3.0  # a refusal is reported for so long

Status = tuple[int, str]  # level and message for /diagnostics


class LearnerStatus:
    """Says OK only while the learner learns. Remembers when trajectories arrived."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._agents: dict[str, tuple[float, float]] = {}  # id → last arrival, usual s between two
        self._any = False  # trajectory arrived yet
        self._last_at = clock()  # arrival of the newest trajectory
        self._frames, self._frames_at = -1.0, clock()  # and when they last grew
        self._refusal, self._refused_at = (WARN, ""), 0.0

    def arrived(self, agent_id: str) -> None:
        """Take note of a trajectory that could be decoded."""
        now = self._clock()
        before_at, usual_s = self._agents.get(agent_id, (now, 0.0))
        since_s = now - before_at
        usual_s = usual_s + 0.2 * (since_s - usual_s) if usual_s else since_s
        self._agents[agent_id] = now, usual_s
        self._any, self._last_at = True, now

    def refused(self, reason: str, level: int = WARN) -> None:
        """Take note of refused input."""
        self._refusal, self._refused_at = (level, f"refuses {reason}"), self._clock()

    def at_work(self, agent_id: str) -> bool:
        """Whether trajectories of an agent arrived lately, so that it can still send more."""
        return self._clock() - self._agents.get(agent_id, (-AT_WORK_S, 0.0))[0] < AT_WORK_S

    def state(
        self, trouble: str, missing: int, backlog: int, frames: float, awaited: str = ""
    ) -> Status:
        """Level and message of a learner that has an arena.

        :param trouble: an error of the worker; empty for none.
        :param missing: trajectories that agents at work have not sent yet.
        :param backlog: trajectories that arrived and wait.
        :param awaited: the agent whose turn it is while trajectories of others wait.
        """
        now = self._clock()
        if frames != self._frames:
            self._frames, self._frames_at = frames, now
        stuck_s = now - self._frames_at
        silent = self._silent(now)
        patient_s = max([IDLE_S, *(PATIENCE * usual_s for _, usual_s in self._agents.values())])
        if trouble:
            return ERROR, trouble
        if self._refusal[1] and now - self._refused_at < REFUSED_S:
            return self._refusal
        if not self._any:
            return WARN, (
                "waits for an agent that learns (trajectories): does agent_node run, with the "
                "parameter learning?"
            )
        if awaited and stuck_s > patient_s:
            return WARN, (
                f"waits for the next trajectory of {awaited!r}; so do all other agents "
                "(learner.schedule.in_step=exact): do its sim_node and agent_node run?"
            )
        if not backlog and len(silent) == len(self._agents):
            silent_s = now - self._last_at
            return WARN, f"no trajectory for {silent_s:.0f} s: do sim_node and agent_node run?"
        if not backlog and stuck_s > patient_s:
            return WARN, (
                f"all trajectories of the last {stuck_s:.0f} s are duplicates: does another agent "
                "use the same agent_id?"
            )
        if missing:
            return WARN, f"{missing} trajectories are missing: their agent sends them again"
        if silent and not backlog:
            return WARN, (
                f"no trajectory of {silent[0]!r} for a while; learns from the others': do its "
                "sim_node and agent_node run?"
            )
        return OK, "learning"

    def _silent(self, now: float) -> list[str]:
        """Agents whose trajectories are overdue. Those that have left are forgotten."""
        silent = []
        for name, (at, usual_s) in list(self._agents.items()):
            overdue_s = now - at - max(IDLE_S, PATIENCE * usual_s)
            if overdue_s > AT_WORK_S and len(self._agents) > 1:
                del self._agents[name]
            elif overdue_s > 0:
                silent.append(name)
        return silent
