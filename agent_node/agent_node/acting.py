"""A node that acts in an arena, as its parts see it: its goals and its other outputs."""

from __future__ import annotations

from abc import abstractmethod

from agent_node.config import AgentConfig
from pa_ros.acting.agent import Agent
from pa_ros.core.experience import Step
from pa_ros.language import Goal
from pa_ros.ros.lifecycle import ManagedNode
from pa_ros.wire.arena import ArenaDescription
from pa_ros.wire.program_book import ProgramBook


class ActingNode(ManagedNode):
    """A managed node with an agent."""

    config: AgentConfig
    agent: Agent
    book: ProgramBook
    seen: tuple[Step, Goal] | None  # the newest step taken in
    given_up: str  # id of the program whose goal was cancelled or took too long

    @property
    @abstractmethod
    def arena(self) -> ArenaDescription | None:
        """The arena that is followed."""
