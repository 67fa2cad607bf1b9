"""What an agent is doing or waiting for, in words that a person can act on."""

from __future__ import annotations

import math
import time

from pa_ros.acting.agent import Agent
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.acting.send_window import Wait
from pa_ros.core.experience import LearnerInfo
from pa_ros.ros.health import ERROR, OK, WARN
from pa_ros.ros.peers import PeerMonitor
from pa_ros.wire.arena import ArenaDescription

QUIET_S = 1.0  # without observations for so long, the agent waits for them
REPORTED_S = 3.0  # an event is reported for so long
WAIT_S = 2.0  # waiting for weights is reported after so long

Status = tuple[int, str]  # level and message for /diagnostics


class AgentStatus:
    """Says OK only while the agent acts. The node writes down what happened when, in seconds of
    `time.monotonic`."""

    def __init__(self, stuck_after_s: float) -> None:
        self.observed_at = time.monotonic()  # a step arrived
        self.step_at = time.monotonic()  # a step was taken in, and acted on or waited with
        self.commanded_at = time.monotonic()  # a command was sent
        self.step_refusal = ""  # why a step since `step_at` was refused
        self.has_program = True  # whether a program was in force at the newest step
        self._stuck_after_s = stuck_after_s
        self._warning, self._warned_at = "", -math.inf

    def restart(self) -> None:
        """Start all times anew: the agent was activated."""
        self.observed_at = self.step_at = self.commanded_at = time.monotonic()

    def warn(self, warning: str) -> None:
        """Report a warning for REPORTED_S."""
        self._warning, self._warned_at = warning, time.monotonic()

    @property
    def idle_s(self) -> float:
        """Time since the newest command."""
        return time.monotonic() - self.commanded_at

    def state(
        self,
        agent: Agent,
        arenas: PeerMonitor[ArenaDescription],
        learners: PeerMonitor[LearnerInfo],
    ) -> Status:
        """Level and message. The first reason counts."""
        return (
            self._cannot_act(agent, arenas.current)
            or self._no_step()
            or ((ERROR, fault) if (fault := arenas.fault or learners.fault) else None)
            or self._doubtful(agent)
            or (OK, "acting" if self.has_program else "waits for a program (program)")
        )

    def _cannot_act(self, agent: Agent, arena: ArenaDescription | None) -> Status | None:
        if agent.rejection:
            return ERROR, f"does not act for the learner: {agent.rejection}"
        if arena is None:
            return WARN, "waits for an arena (arena_info): does sim_node run in this ROS domain?"
        required = agent.required()
        reason = f": waits for {required.reason}" if isinstance(required, Wait) else ""
        if not agent.has_weights:
            return WARN, f"no weights yet{reason}; does learner_node run?"
        if agent.waiting and reason and self.idle_s > self._stuck_after_s:
            return ERROR, f"policy version stuck at {agent.version}{reason}; does learner_node run?"
        if agent.waiting and reason and self.idle_s > WAIT_S:
            return WARN, f"does not act with version {agent.version}{reason}"
        return None

    def _no_step(self) -> Status | None:
        age_s = time.monotonic() - self.observed_at
        reason = self.step_refusal
        if reason and age_s < REPORTED_S and time.monotonic() - self.step_at > QUIET_S:
            return WARN, f"takes in no step: {reason}"
        if age_s > QUIET_S:
            return WARN, "waits for observations (object_features): has sim_node ended or paused?"
        return None

    def _doubtful(self, agent: Agent) -> Status | None:
        if isinstance(agent, LearningAgent) and agent.stalled:
            return WARN, (
                f"acts with version {agent.version}, but its learner takes in no trajectories "
                f"({len(agent.unaccounted)} wait); does learner_node run?"
            )
        recent = time.monotonic() - self._warned_at < REPORTED_S
        return (WARN, self._warning) if recent else None
