"""Entry point of `sim_node`."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from pa_ros.core.software import check_opengl
from pa_ros.ros.node_main import Shell, run_node

if TYPE_CHECKING:
    from pa_ros.core.settings import Settings


def make() -> Shell:
    """The node; imported here, after the environment is prepared."""
    check_opengl()
    from sim_node.node import SimNode

    return SimNode()


def settings() -> type[Settings]:
    """The node's parameters."""
    from sim_node.config import SimConfig

    return SimConfig


def main() -> int:
    """Run the arena until SIGINT or SIGTERM; the exit status."""
    return run_node("sim_node", make, settings)


if __name__ == "__main__":
    sys.exit(main())
