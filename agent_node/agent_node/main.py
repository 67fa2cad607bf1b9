"""Entry point of `agent_node`."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from pa_ros.ros.node_main import Shell, run_node

if TYPE_CHECKING:
    from pa_ros.core.settings import Settings


def make() -> Shell:
    """The node; imported here, after the environment is prepared."""
    from agent_node.node import AgentNode

    return AgentNode()


def settings() -> type[Settings]:
    """The node's parameters."""
    from agent_node.config import AgentConfig

    return AgentConfig


def main() -> int:
    """Run the agent until SIGINT or SIGTERM; the exit status."""
    return run_node("agent_node", make, settings)


if __name__ == "__main__":
    sys.exit(main())
