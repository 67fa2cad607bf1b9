"""What an agent offers beside its answers to an arena."""

from __future__ import annotations

from rclpy.node import Node

from agent_node.acting import Acting
from agent_node.adapter import Adapter
from agent_node.goals import ProgramGoals
from agent_node.outlines import Outlines


class Components:
    """Goals, unless it learns; commands to controllers, if asked for; what viewers show."""

    def __init__(self, node: Node, acting: Acting) -> None:
        config = acting.config
        self.adapter: Adapter | None = None
        self._goals: ProgramGoals | None = None
        if not config.learning:
            self._goals = ProgramGoals(node, acting)
        if config.controller != "none":
            self.adapter = Adapter(node, config, lambda: acting.arena)
        Outlines(node, acting)

    def gave_up(self, program_id: str) -> bool:
        """Whether to hold the arm under a program: as a goal, it was cancelled or took too long."""
        return self._goals is not None and self._goals.gave_up(program_id)

    def rest(self) -> None:
        """The agent is not active any more: its goal ends, the arm stops."""
        if self._goals is not None:
            self._goals.abandon()
        if self.adapter is not None:
            self.adapter.rest()

    def close(self) -> None:
        """The node goes."""
        if self.adapter is not None:
            self.adapter.stop()
