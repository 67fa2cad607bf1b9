"""Entry point of `robot_node`."""

import sys

from pa_ros.ros.node_main import run_node

NODE = "sim_node.robot.node:RobotNode"  # imported after the environment is prepared


def main() -> int:
    """Run until SIGINT or SIGTERM; the exit status."""
    return run_node("robot_node", NODE, settings="sim_node.robot.node:RobotConfig")


if __name__ == "__main__":
    sys.exit(main())
