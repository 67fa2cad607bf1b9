"""What an agent's components know of it."""

from __future__ import annotations

from typing import Protocol

from agent_node.config import AgentConfig
from pa_ros.acting.agent import Agent
from pa_ros.core.experience import Observation
from pa_ros.language import Program
from pa_ros.ros.refusals import Refusals
from pa_ros.wire.arena import ArenaDescription


class Acting(Protocol):
    """The node."""

    config: AgentConfig
    agent: Agent
    refusals: Refusals
    seen: tuple[Observation, Program] | None  # the newest step taken in
    active: bool

    @property
    def arena(self) -> ArenaDescription | None:
        """The one that counts now."""
