"""Entry point of `camera_node`."""

import sys

from pa_ros.ros.node_main import run_node

NODE = "sim_node.camera.node:CameraNode"  # imported after the environment is prepared


def main() -> int:
    """Run until SIGINT or SIGTERM; the exit status."""
    return run_node("camera_node", NODE, settings="sim_node.camera.node:SeeingConfig")


if __name__ == "__main__":
    sys.exit(main())
