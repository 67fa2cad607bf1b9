"""Entry point of `sim_node`."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from pa_ros.core.opengl import check_opengl
from pa_ros.ros.node_main import Shell, run_node

if TYPE_CHECKING:
    from pa_ros.core.settings import Settings


def main() -> int:
    """Run the arena until SIGINT or SIGTERM; the exit status."""

    def make() -> Shell:
        check_opengl()
        from sim_node.node import SimNode  # after the environment is prepared

        return SimNode()

    def settings() -> type[Settings]:
        from sim_node.config import SimConfig

        return SimConfig

    return run_node("sim_node", make, settings)


if __name__ == "__main__":
    sys.exit(main())
