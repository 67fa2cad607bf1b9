"""Entry point of `sim_node`."""

import sys
from typing import Any

from pa_ros.core.software import check_opengl
from pa_ros.ros.node_main import run_node


def make() -> Any:
    """The node; imported here, after the environment is prepared."""
    check_opengl()
    from sim_node.node import SimNode

    return SimNode()


NODE = make


def main() -> int:
    """Run the arena until SIGINT or SIGTERM; the exit status."""
    return run_node("sim_node", NODE, settings="sim_node.config:SimConfig")


if __name__ == "__main__":
    sys.exit(main())
