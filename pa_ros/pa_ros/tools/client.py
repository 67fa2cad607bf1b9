"""A node of a command-line tool: it watches or asks, and is gone when the command ends."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from rclpy.node import Node

from pa_ros.core.errors import ConfigError
from pa_ros.ros.environment import prepare_environment, start_ros

__all__ = ["Node", "client_node"]


@contextmanager
def client_node(name: str, namespace: str = "") -> Iterator[Node]:
    """A node named `<name>_<pid>`, ROS being up for as long as it lives; signals are left alone.

    One at a time in a process. Raises ConfigError for what ROS refuses.
    """
    prepare_environment()
    import rclpy
    from rclpy.exceptions import InvalidNamespaceException

    from pa_ros.ros.executor import release

    start_ros([])
    try:
        try:
            node = rclpy.create_node(
                f"{name}_{os.getpid()}",
                namespace=f"/{namespace.strip('/')}",
                enable_rosout=False,
                start_parameter_services=False,
            )
        except InvalidNamespaceException as error:
            raise ConfigError(f"namespace: {error}") from error
        try:
            yield node
        finally:
            release(node)
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
