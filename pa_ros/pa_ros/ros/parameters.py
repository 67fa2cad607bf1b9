"""A node's settings as ROS parameters.

The node must have been made with `automatically_declare_parameters_from_overrides`, so that an
unknown parameter is rejected and not ignored. A setting of a part is a nested parameter
(`learner.updates.discount`). A list is an array parameter; one empty text stands for an empty list,
since ROS cannot tell the type of an empty array.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from pa_ros.core.errors import ConfigError
from pa_ros.core.settings import Leaf, Settings

Kind = TypeVar("Kind", bound=Settings)
SIM_TIME = "use_sim_time"
ROS_PARAMETERS = (SIM_TIME, "start_type_description_service")  # rclpy declares these itself
ROS_PREFIX = "qos_overrides."


class NodeParameters(Generic[Kind]):
    """The parameters of a node: open until they are fixed as settings, then read-only.

    While they are open, a parameter that nobody gave has no value, because its default may depend
    on others (a recipe is a named set of defaults). Once fixed, all have their effective value.
    """

    def __init__(self, node: Node, kind: type[Kind]) -> None:
        self._node, self._kind = node, kind
        self._given = self._values()
        self._leaves: dict[str, Leaf] = {}  # of the parameters that can be set now
        node.add_on_set_parameters_callback(self._check)
        self.open()

    def open(self) -> None:
        """Let parameters be set until the next `fix`."""
        node, self._leaves = self._node, {}
        leaves = {leaf.path: leaf for leaf in self._kind.leaves()}
        for path in {**leaves, **self._values()}:
            self._undeclare(path)
            if path in leaves or path in self._given:
                about = describe(leaves[path]) if path in leaves else ParameterDescriptor()
                about.read_only, about.dynamic_typing = False, True
                value = to_ros(self._given[path]) if path in self._given else None
                node.declare_parameter(path, value, about, ignore_override=True)
        self._leaves = leaves  # last: `fix` rejects a wrong value that was given at the start

    def fix(self) -> Kind:
        """Build the settings and make every parameter read-only, with its effective value.

        Raises ConfigError for an unknown parameter, or for a value that the settings reject.
        """
        # Also kept if they are rejected, so that one can be corrected.
        self._given, self._leaves = self._values(), {}
        return self.fix_again()

    def fix_again(self, **values: Any) -> Kind:
        """As `fix`, with these values by name where none was given, or an empty one."""
        given = {path: value for path, value in self._given.items() if value or path not in values}
        settings = self._kind(**values | given)
        leaves = {leaf.path: leaf for leaf in settings.own_leaves()}
        # Another algorithm than the default one may lack some of the settings declared so far.
        for path in {leaf.path: leaf for leaf in self._kind.leaves()} | leaves:
            self._undeclare(path)
        for leaf in leaves.values():
            value = to_ros(leaf.default)
            self._node.declare_parameter(leaf.path, value, describe(leaf), ignore_override=True)
        return settings

    def _undeclare(self, path: str) -> None:
        if self._node.has_parameter(path):
            self._node.describe_parameter(path).read_only = False
            self._node.undeclare_parameter(path)

    def _check(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Reject a value that its setting rejects, in the words of the setting."""
        try:
            for one in parameters:
                if one.name in self._leaves and one.value is not None:
                    self._leaves[one.name].check(_from_ros(one.value))
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _values(self) -> dict[str, Any]:
        """The values of our parameters that have one, by name."""
        found = self._node.get_parameters_by_prefix("")
        sim_time = found[SIM_TIME].value if SIM_TIME in found else False
        if not isinstance(sim_time, bool):  # rclpy would take it for false
            raise ConfigError(f"{SIM_TIME}: expected true or false, got {sim_time!r}")
        return {
            name: _from_ros(parameter.value)
            for name, parameter in found.items()
            if parameter.value is not None
            and name not in ROS_PARAMETERS
            and not name.startswith(ROS_PREFIX)
        }


def describe(leaf: Leaf) -> ParameterDescriptor:
    """The description of a setting that `ros2 param describe` shows."""
    return ParameterDescriptor(
        description=leaf.description, additional_constraints=leaf.expected, read_only=True
    )


def to_ros(value: Any) -> Any:
    """A setting as a parameter's value."""
    return list(value or ("",)) if isinstance(value, tuple) else value


def _from_ros(value: Any) -> Any:
    if isinstance(value, (str, bool, int, float)):
        return value
    return tuple(item for item in value if item != "")
