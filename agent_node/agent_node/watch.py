"""What an agent is doing, or waits for, in words that a person can act on."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

from pa_ros.acting.agent import Agent
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.acting.send_window import Wait
from pa_ros.core.experience import AgentKey, Executed
from pa_ros.ros import topics
from pa_ros.ros.arenas import Arenas
from pa_ros.ros.health import ERROR, OK, WARN
from pa_ros.ros.learners import Learners

QUIET_S = 1.0  # without observations for so long, the agent waits for them
SAID_S = 3.0  # what was over at once is worth a word for so long
WAIT_S = 2.0  # waiting for weights longer than this is worth a word


class Watch:
    """Remembers what happened when."""

    def __init__(self, stuck_after_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.idle = False  # the newest step had no program in force
        self._stuck_after_s, self._clock = stuck_after_s, clock
        self._heard_at = self._progress_at = clock()
        self._foreign, self._foreign_at = "", -math.inf  # who else moved the arm, and when
        self._overtaken, self._overtaken_at = 0, -math.inf
        self._held, self._held_at = "", -math.inf  # why the arm was held, and when
        self._took_in_at = clock()  # a whole step, and acted on it or knew why not
        self._refused = ""  # why a step since then was not

    def heard(self) -> None:
        """A part of a step has come."""
        self._heard_at = self._clock()

    def took_in(self) -> None:
        """A step was whole, and acted on or waited with."""
        self._took_in_at, self._refused = self._clock(), ""

    def refused(self, reason: str) -> None:
        """A step, or a part of one, was refused."""
        self._refused = reason

    def progress(self) -> None:
        """A command was sent."""
        self._progress_at = self._clock()

    def executed(self, executed: Executed | None, key: AgentKey) -> None:
        """The arena says what it carried out; `key`: of this agent."""
        if executed is not None and executed.command[:2] != key:
            self._foreign, self._foreign_at = executed.command.agent_id, self._clock()

    def held(self, reason: str) -> None:
        """The arm was held, since the program in force can't be acted on."""
        self._held, self._held_at = reason, self._clock()

    @property
    def observation_age_s(self) -> float:
        """Since something of the arena was heard."""
        return self._clock() - self._heard_at

    @property
    def idle_s(self) -> float:
        """Since the newest command."""
        return self._clock() - self._progress_at

    def state(
        self, agent: Agent, arenas: Arenas, learners: Learners, lacking: Sequence[str] = ()
    ) -> tuple[int, str]:
        """Level and message; `lacking`: topics that the newest step waits for."""
        trouble = self._trouble(agent, arenas) or self._no_step(lacking)
        if trouble is not None:
            return trouble
        alarm = arenas.alarm or learners.alarm
        if alarm:
            return WARN, alarm
        if self._clock() - self._foreign_at < SAID_S:
            return WARN, f"the arm obeys {self._foreign!r}, too: stop one of the agents"
        if self._is_overtaken(agent):
            return WARN, (
                "someone else sends trajectories under this agent's name: stop it, or give each "
                "its own agent_id"
            )
        if isinstance(agent, LearningAgent) and agent.stalled:
            return WARN, (
                f"acts on with version {agent.version}, though its learner takes in no "
                f"trajectories ({len(agent.unaccounted)} wait); does learner_node run?"
            )
        if self._clock() - self._held_at < SAID_S:
            return WARN, f"holds the arm, and learns nothing: {self._held}"
        return OK, f"waits for a program ({topics.PROGRAM.name})" if self.idle else "acting"

    def _is_overtaken(self, agent: Agent) -> bool:
        times = agent.overtaken if isinstance(agent, LearningAgent) else 0
        if times > self._overtaken:
            self._overtaken, self._overtaken_at = times, self._clock()
        return self._clock() - self._overtaken_at < SAID_S

    def _trouble(self, agent: Agent, arenas: Arenas) -> tuple[int, str] | None:
        """Why it doesn't act; None if it does."""
        if agent.rejection:
            return ERROR, f"does not act for the learner: {agent.rejection}"
        if arenas.current is None:
            name = topics.ARENA_INFO.name
            return WARN, f"waits for an arena ({name}): does sim_node run in this ROS domain?"
        required = agent.required()
        reason = f": waits for {required.reason}" if isinstance(required, Wait) else ""
        if not agent.has_weights:
            return WARN, f"no weights yet{reason}; does learner_node run?"
        if agent.waiting and reason and self.idle_s > self._stuck_after_s:
            return ERROR, f"policy version stuck at {agent.version}{reason}; does learner_node run?"
        if agent.waiting and reason and self.idle_s > WAIT_S:
            return WARN, f"does not act with version {agent.version}{reason}"
        return None

    def _no_step(self, lacking: Sequence[str]) -> tuple[int, str] | None:
        """Why it takes in no step, if it takes in none."""
        missing = f"{' and '.join(lacking)} of the same stamp do not come" if lacking else ""
        reason, age_s = self._refused or missing, self.observation_age_s
        if reason and age_s < SAID_S and self._clock() - self._took_in_at > QUIET_S:
            return WARN, f"takes in no step: {reason}"
        if age_s > QUIET_S:
            name = topics.OBJECT_FEATURES.name
            return WARN, f"waits for observations ({name}): is sim_node gone, or paused?"
        return None
