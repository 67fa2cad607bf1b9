"""Entry point of `learner_node`."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from pa_ros.ros.node_main import Shell, run_node

if TYPE_CHECKING:
    from pa_ros.core.settings import Settings


def make() -> Shell:
    """The node; imported here, after the environment is prepared."""
    from learner_node.node import LearnerNode

    return LearnerNode()


def settings() -> type[Settings]:
    """The node's parameters."""
    from learner_node.config import LearnerNodeConfig

    return LearnerNodeConfig


def main() -> int:
    """Run the learner until SIGINT or SIGTERM; the exit status."""
    # A checkpoint may take a while; what agents have sent last is on its way.
    return run_node("learner_node", make, settings, grace_s=60.0, lingers_s=1.0)


if __name__ == "__main__":
    sys.exit(main())
