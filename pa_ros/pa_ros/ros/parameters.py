"""A node's frozen configuration from its ROS parameters, built once and then fixed."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from pa_ros.core.errors import ConfigError

Config = TypeVar("Config")
OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides")


def config_from_parameters(node: Node, config_type: type[Config]) -> Config:
    """Build a config dataclass, one parameter per field; every field has a plain default.

    The node must have been made with `automatically_declare_parameters_from_overrides`, so that
    a parameter that nothing reads is refused and not ignored. Tuples are array parameters.
    Raises ConfigError for an unknown name, a wrong type, or what the dataclass itself refuses.
    Later attempts to set a parameter are rejected with a reason.
    """
    given: dict[str, Parameter] = node.get_parameters_by_prefix("")
    known = {field.name for field in fields(config_type)}  # type: ignore[arg-type]
    unknown = [n for n in given if n not in known and not n.startswith(OF_ROS)]
    if unknown:
        raise ConfigError(
            f"{node.get_name()}: expected parameters {sorted(known)}, got {sorted(unknown)}"
        )
    values = {}
    for field in fields(config_type):  # type: ignore[arg-type]
        default = field.default
        if field.name in given:
            values[field.name] = _typed(field.name, given[field.name].value, default)
        else:
            node.declare_parameter(field.name, _plain(default))
    config = config_type(**values)
    node.add_on_set_parameters_callback(_reject)
    return config


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) and value else value if value != () else [""]


def _typed(name: str, value: Any, default: Any) -> Any:
    """The value in the default's type; a whole number passes for a float."""
    if isinstance(default, float) and type(value) is int:
        return float(value)
    if isinstance(default, tuple) and isinstance(value, (list, tuple)):
        return tuple(item for item in value if item != "")
    if type(value) is not type(default):
        expected = type(default).__name__
        raise ConfigError(f"parameter {name}: expected {expected}, got {value!r}")
    return value


def _reject(parameters: list[Parameter]) -> SetParametersResult:
    names = ", ".join(parameter.name for parameter in parameters)
    return SetParametersResult(
        successful=False, reason=f"{names}: fixed while the node runs; restart it to change them"
    )
