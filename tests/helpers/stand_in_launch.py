"""A stand-in for `launch` and `launch_ros`, which are not on the Python index.

It has the classes that our launch files use, accepts the arguments that those of Jazzy (launch 3.4,
launch_ros 0.26) accept, and no others, and resolves them to command lines. It does not prove that
`ros2 launch` does the same.
"""

import runpy
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import patch

import yaml
from ament_index_python.packages import get_package_share_directory

Context = dict[str, str]


class Substitution:
    """What becomes text once the launch arguments are known."""

    def perform(self, context: Context) -> str:
        raise NotImplementedError


def parts(given: Any) -> list[str | Substitution]:
    """Text, a substitution or a flat list of both, as a list; a TypeError like launch's own."""
    found = [given] if isinstance(given, (str, Substitution)) else list(given)
    for one in found:
        if not isinstance(one, (str, Substitution)):
            raise TypeError(f"expected str or Substitution, got {type(one).__name__}")
    return found


def text(given: list[str | Substitution], context: Context) -> str:
    return "".join(one if isinstance(one, str) else one.perform(context) for one in given)


class LaunchConfiguration(Substitution):
    def __init__(self, variable_name: Any) -> None:
        self._name = parts(variable_name)

    def perform(self, context: Context) -> str:
        return context[text(self._name, context)]


class FindPackageShare(Substitution):
    def __init__(self, package: Any) -> None:
        self._package = parts(package)

    def perform(self, context: Context) -> str:
        return get_package_share_directory(text(self._package, context))


class EqualsSubstitution(Substitution):
    def __init__(self, left: Any, right: Any) -> None:
        self._left, self._right = parts(left), parts(right)

    def perform(self, context: Context) -> str:
        return str(text(self._left, context) == text(self._right, context)).lower()


class IfCondition:
    def __init__(self, predicate_expression: Any) -> None:
        self._expression = parts(predicate_expression)

    def evaluate(self, context: Context) -> bool:
        return {"true": True, "1": True, "false": False, "0": False}[
            text(self._expression, context).lower()
        ]


class ParameterValue:
    def __init__(self, value: Any, *, value_type: type[bool]) -> None:
        self._value = parts(value)
        assert value_type is bool

    def perform(self, context: Context) -> str:
        value = text(self._value, context)
        assert isinstance(yaml.safe_load(value), bool), value
        return value


class DeclareLaunchArgument:
    def __init__(self, name: str, *, default_value: Any, description: str) -> None:
        self.name, self.description = name, description
        self.default = parts(default_value)


class Shutdown:
    def __init__(self, *, reason: str) -> None:
        assert isinstance(reason, str)


class Node:
    def __init__(
        self,
        *,
        package: str,
        executable: str,
        name: str,
        namespace: Any,
        parameters: list[Any],
        remappings: list[tuple[Any, Any]],
        output: str,
        arguments: Sequence[Any] = (),
        on_exit: Shutdown | None = None,
        condition: IfCondition | None = None,
    ) -> None:
        self.package, self.executable, self.name = package, executable, name
        self.output, self.on_exit, self.condition = output, on_exit, condition
        self._namespace = parts(namespace)
        self._arguments = [parts(one) for one in arguments]
        if not isinstance(parameters, list):
            raise TypeError(f"parameters: expected a list, got {type(parameters).__name__}")
        self._parameters = [one if isinstance(one, Mapping) else parts(one) for one in parameters]
        if not all(isinstance(rule, tuple) and len(rule) == 2 for rule in remappings):
            raise TypeError(f"remappings: expected tuples of two, got {remappings}")
        self._remappings = [(parts(source), parts(target)) for source, target in remappings]

    def command(self, context: Context) -> list[str]:
        """The command line of the node, as launch_ros builds it."""
        words = [text(word, context) for word in self._arguments] + ["--ros-args"]
        namespace = text(self._namespace, context)
        words += ["-r", f"__node:={self.name}"]
        words += ["-r", f"__ns:=/{namespace.strip('/')}"] if namespace else []
        for given in self._parameters:
            if isinstance(given, Mapping):
                for key, value in given.items():
                    words += ["-p", f"{key}:={value.perform(context)}"]
            else:
                words += ["--params-file", text(given, context)]
        for source, target in self._remappings:
            words += ["-r", f"{text(source, context)}:={text(target, context)}"]
        return words


class LaunchDescription:
    def __init__(self, initial_entities: list[Any]) -> None:
        known = (DeclareLaunchArgument, Node)
        assert all(isinstance(one, known) for one in initial_entities), initial_entities
        self.entities = initial_entities

    @property
    def arguments(self) -> list[DeclareLaunchArgument]:
        return [one for one in self.entities if isinstance(one, DeclareLaunchArgument)]

    def started(self, **given: str) -> list[tuple[Node, list[str]]]:
        """The nodes that would start, each with its arguments."""
        unknown = set(given) - {one.name for one in self.arguments}
        assert not unknown, f"no such argument: {unknown}"
        context: Context = {}
        for one in self.arguments:
            context[one.name] = given.get(one.name) or text(one.default, context)
        nodes = [one for one in self.entities if isinstance(one, Node)]
        return [
            (node, node.command(context))
            for node in nodes
            if node.condition is None or node.condition.evaluate(context)
        ]


MODULES: dict[str, list[type]] = {
    "launch": [LaunchDescription],
    "launch.actions": [DeclareLaunchArgument, Shutdown],
    "launch.conditions": [IfCondition],
    "launch.substitutions": [EqualsSubstitution, LaunchConfiguration],
    "launch_ros": [],
    "launch_ros.actions": [Node],
    "launch_ros.parameter_descriptions": [ParameterValue],
    "launch_ros.substitutions": [FindPackageShare],
}


def described(path: Path) -> LaunchDescription:
    """The description of a launch file, with this module as `launch`."""
    modules = {}
    for name, classes in MODULES.items():
        modules[name] = ModuleType(name)
        for one in classes:
            setattr(modules[name], one.__name__, one)
    with patch.dict(sys.modules, modules):
        found = runpy.run_path(str(path))["generate_launch_description"]()
    assert isinstance(found, LaunchDescription)
    return found
