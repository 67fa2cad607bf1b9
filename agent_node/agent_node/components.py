"""What an agent offers beside its answers to an arena."""

from __future__ import annotations

from typing import Protocol

from rclpy.node import Node

from agent_node.adapter import Adapter
from agent_node.config import AgentConfig
from agent_node.goals import ProgramGoals
from agent_node.outlines import Outlines
from pa_ros.acting.agent import Agent
from pa_ros.core.experience import Observation
from pa_ros.language import Program
from pa_ros.ros.refusals import Refusals
from pa_ros.wire.records import ArenaDescription


class Acting(Protocol):
    """What the node knows."""

    config: AgentConfig
    agent: Agent
    refusals: Refusals
    seen: tuple[Observation, Program] | None  # the newest step taken in

    @property
    def arena(self) -> ArenaDescription | None:
        """The one that counts now."""


class Components:
    """Goals, unless it learns; commands to controllers, if asked for; what viewers show."""

    def __init__(self, node: Node, acting: Acting) -> None:
        agent, refusals, config = acting.agent, acting.refusals, acting.config
        self.adapter: Adapter | None = None
        self._goals: ProgramGoals | None = None
        if not config.learning:
            self._goals = ProgramGoals(
                node, agent, refusals, lambda: acting.arena, lambda: acting.seen
            )
        if config.controller != "none":
            self.adapter = Adapter(node, config, lambda: acting.arena)
        Outlines(node, agent, refusals, lambda: acting.seen)

    def gave_up(self, program_id: str) -> bool:
        """Whether to hold the arm under a program: as a goal, it was cancelled or took too long."""
        return self._goals is not None and self._goals.gave_up(program_id)

    def close(self) -> None:
        """Call before the node is destroyed."""
        if self._goals is not None:
            self._goals.close()
