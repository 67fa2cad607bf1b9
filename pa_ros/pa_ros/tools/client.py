"""A node of a command-line tool: it watches or asks, and is gone when the command ends."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rclpy.node import Node

from pa_ros.core.errors import ConfigError
from pa_ros.ros.environment import prepare_environment, start_ros

__all__ = ["Node", "client_node", "elsewhere", "namespaces_of_arenas", "spin_with_notice"]

NOTICE_S = 3.0


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


def spin_with_notice(node: Node, condition: Callable[[], bool], timeout_s: float) -> bool:
    """`spin_until`, but says so once on standard error where there is no arena at all to answer."""
    from pa_ros.ros.executor import spin_until
    from pa_ros.ros.topics import ARENA_INFO

    at_once = min(NOTICE_S, timeout_s)
    if spin_until(node, condition, at_once):
        return True
    if timeout_s > at_once and not node.get_publishers_info_by_topic(ARENA_INFO.name):
        domain = node.context.get_domain_id()
        print(
            f"no arena yet in ROS domain {domain}, namespace {node.get_namespace()}: "
            f"waits for one, {timeout_s:g} s at most{elsewhere(node)}",
            file=sys.stderr,
            flush=True,
        )
    return spin_until(node, condition, timeout_s - at_once)


def namespaces_of_arenas(node: Node) -> tuple[str, ...]:
    """Namespaces in which an arena describes itself; `/` is the root."""
    from pa_ros.ros.topics import ARENA_INFO

    name = f"/{ARENA_INFO.name}"
    return tuple(sorted(
        topic.removesuffix(name) or "/"
        for topic, _ in node.get_topic_names_and_types()
        if topic.endswith(name) and node.count_publishers(topic)
    ))  # fmt: skip


def elsewhere(node: Node) -> str:
    """Where arenas are, behind a line that says that none is here; empty: here, or nowhere."""
    found = namespaces_of_arenas(node)
    if not found or node.get_namespace() in found:
        return ""
    return f"; an arena describes itself in {', '.join(found)}: --namespace chooses it"
