"""Names in the graph that people give."""

from __future__ import annotations

import re

from pa_ros.core.errors import ConfigError

NAMESPACE = re.compile(r"/?([A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*)?")
LONGEST = 200  # characters; ROS has 245 for a namespace, 247 for a topic with all before it


def check_namespace(text: str, what: str = "namespace") -> None:
    """Raise ConfigError, which names `what`, unless ROS can have it: empty text and "/", too."""
    if len(text) > LONGEST or not NAMESPACE.fullmatch(text):
        raise ConfigError(
            f"{what}: expected a namespace such as lab/arm_1 or /lab/arm_1 (letters, digits and _, "
            f"no digit first), of at most {LONGEST} characters, got {text[: LONGEST + 1]!r}"
        )
