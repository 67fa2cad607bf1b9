"""A node's settings from its ROS parameters, built once and then fixed."""

from __future__ import annotations

import sys
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from pa_ros.core.errors import ConfigError
from pa_ros.core.settings import Leaf, Settings

Kind = TypeVar("Kind", bound=Settings)
SIM_TIME = "use_sim_time"
OF_ROS = (SIM_TIME, "start_type_description_service")
QOS = "qos_overrides."  # what ROS's names of any topic begin with
LARGEST = {int: 2**63 - 1, float: sys.float_info.max}  # stands for no bound


def declare_settings(node: Node, kind: type[Settings]) -> None:
    """Declare every setting that was not given, and describe all; they may be set until
    `settings_from_parameters` fixes them. Raises ConfigError for an unknown name."""
    given = _given(node, kind)
    for leaf in kind.leaves():
        about = describe(leaf)
        about.read_only, about.dynamic_typing = False, True
        if leaf.path in given:  # what it is, is judged later
            about.integer_range, about.floating_point_range = [], []
            node.set_descriptor(leaf.path, about)
        else:
            node.declare_parameter(leaf.path, to_ros(leaf.default), about)


def loosen_settings(node: Node, kind: type[Settings]) -> None:
    """They may be set again, for the next `settings_from_parameters`; one that somebody deleted
    has its default."""
    for leaf in kind.leaves():
        if not node.has_parameter(leaf.path):
            node.declare_parameter(leaf.path, to_ros(leaf.default), describe(leaf))
        node.describe_parameter(leaf.path).read_only = False


def settings_from_parameters(node: Node, kind: type[Kind]) -> Kind:
    """Build settings, one parameter for each dotted path; every one has a default.

    The node must have been made with `automatically_declare_parameters_from_overrides`, so that
    a parameter that nothing reads is refused and not ignored. Tuples are array parameters; one
    empty text stands for none. Parameters are then declared with what is known of them, read-only.
    Raises ConfigError for an unknown name, or for what the settings refuse.
    """
    given = _given(node, kind)
    values = {path: _from_ros(given[path].value) for path in kind.paths() if path in given}
    settings = kind().changed(**values)
    for leaf in kind.leaves():  # again: extensions may have brought choices
        path = leaf.path
        if path in given:
            node.undeclare_parameter(path)
        value = to_ros(settings.value(path))
        node.declare_parameter(path, value, describe(leaf), ignore_override=True)
    return settings


def _given(node: Node, kind: type[Settings]) -> dict[str, Any]:
    """The parameters that a node has, by name. Raises ConfigError for an unknown one, and for a
    `use_sim_time` that is no bool, which rclpy takes for false."""
    leaves = kind.paths()
    given: dict[str, Any] = node.get_parameters_by_prefix("")
    known = {*leaves, *OF_ROS}
    unknown = [name for name in given if name not in known and not name.startswith(QOS)]
    if unknown:
        raise ConfigError(
            f"{node.get_name()}: expected parameters {sorted(leaves)}, got {sorted(unknown)}"
        )
    if SIM_TIME in given and not isinstance(given[SIM_TIME].value, bool):
        raise ConfigError(
            f"{node.get_name()}: {SIM_TIME}: expected true or false, got {given[SIM_TIME].value!r}"
        )
    return given


def describe(leaf: Leaf) -> ParameterDescriptor:
    """What `ros2 param describe` tells of a setting."""
    described = ParameterDescriptor(
        description=leaf.description, additional_constraints=leaf.expected, read_only=True
    )
    if leaf.minimum is None and leaf.maximum is None:
        return described
    largest = LARGEST[leaf.type]
    low = -largest if leaf.minimum is None else leaf.type(leaf.minimum)
    high = largest if leaf.maximum is None else leaf.type(leaf.maximum)
    if leaf.type is int:
        described.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    else:
        described.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return described


def to_ros(value: Any) -> Any:
    """A setting as a parameter's value."""
    return list(value or ("",)) if isinstance(value, tuple) else value


def _from_ros(value: Any) -> Any:
    if isinstance(value, (str, bool, int, float)):
        return value
    return tuple(item for item in value if item != "")
