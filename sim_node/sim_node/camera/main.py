"""Entry point of `camera_node`."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from pa_ros.ros.node_main import Shell, run_node

if TYPE_CHECKING:
    from pa_ros.core.settings import Settings


def make() -> Shell:
    """The node; imported here, after the environment is prepared."""
    from sim_node.camera.node import CameraNode

    return CameraNode()


def settings() -> type[Settings]:
    """The node's parameters."""
    from sim_node.camera.node import SeeingConfig

    return SeeingConfig


def main() -> int:
    """Run until SIGINT or SIGTERM; the exit status."""
    return run_node("camera_node", make, settings)


if __name__ == "__main__":
    sys.exit(main())
