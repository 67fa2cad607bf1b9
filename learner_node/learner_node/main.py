"""Entry point of `learner_node`."""

import sys

from pa_ros.ros.node_main import run_node

NODE = "learner_node.node:LearnerNode"  # imported after the environment is prepared


def main() -> int:
    """Run the learner until SIGINT or SIGTERM; the exit status."""
    # A checkpoint may take a while; what agents have sent last is on its way.
    settings = "learner_node.config:LearnerNodeConfig"
    return run_node("learner_node", NODE, settings=settings, grace_s=60.0, lingers_s=1.0)


if __name__ == "__main__":
    sys.exit(main())
