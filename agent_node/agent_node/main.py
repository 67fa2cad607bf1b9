"""Entry point of `agent_node`."""

import sys

from pa_ros.ros.node_main import run_node

NODE = "agent_node.node:AgentNode"  # imported after the environment is prepared


def main() -> int:
    """Run the agent until SIGINT or SIGTERM; the exit status."""
    return run_node("agent_node", NODE, settings="agent_node.config:AgentConfig")


if __name__ == "__main__":
    sys.exit(main())
