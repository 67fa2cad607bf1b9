"""A stand-in for `launch` and `launch_ros`, which are not on the Python index.

It has the classes that our launch files use, with the names and arguments of Jazzy, and resolves
them to command lines. It does not prove that `ros2 launch` does the same.
"""

from __future__ import annotations

import runpy
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import patch

from ament_index_python.packages import get_package_share_directory

Context = dict[str, str]


def text(value: Any, context: Context) -> str:
    """A substitution, or a list of them, as text."""
    if isinstance(value, (list, tuple)):
        return "".join(text(part, context) for part in value)
    return value if isinstance(value, str) else value.perform(context)


@dataclass
class LaunchConfiguration:
    variable_name: str

    def perform(self, context: Context) -> str:
        return context[self.variable_name]


@dataclass
class PathJoinSubstitution:
    substitutions: list[Any]

    def perform(self, context: Context) -> str:
        return str(Path(*(text(part, context) for part in self.substitutions)))


@dataclass
class FindPackageShare:
    package: str

    def perform(self, context: Context) -> str:
        return get_package_share_directory(self.package)


@dataclass
class ParameterValue:
    value: Any
    value_type: type

    def perform(self, context: Context) -> str:
        return text(self.value, context)


@dataclass
class EqualsSubstitution:
    left: Any
    right: Any

    def perform(self, context: Context) -> str:
        return str(text(self.left, context) == text(self.right, context)).lower()


@dataclass
class IfCondition:
    predicate_expression: Any

    def evaluate(self, context: Context) -> bool:
        return text(self.predicate_expression, context) == "true"


@dataclass
class DeclareLaunchArgument:
    name: str
    default_value: Any
    description: str


@dataclass
class Shutdown:
    reason: str


@dataclass
class Node:
    package: str
    executable: str
    name: str
    namespace: Any
    parameters: list[Any]
    remappings: list[tuple[Any, Any]]
    output: str
    arguments: list[Any] = field(default_factory=list)
    on_exit: Shutdown | None = None
    condition: IfCondition | None = None

    def command(self, context: Context) -> list[str]:
        """The command line of the node, as launch_ros builds it."""
        words = [text(word, context) for word in self.arguments] + ["--ros-args"]
        namespace = text(self.namespace, context)
        words += ["-r", f"__node:={self.name}"]
        words += ["-r", f"__ns:=/{namespace.strip('/')}"] if namespace else []
        for given in self.parameters:
            if isinstance(given, Mapping):
                for key, value in given.items():
                    words += ["-p", f"{key}:={text(value, context)}"]
            else:
                words += ["--params-file", text(given, context)]
        for source, target in self.remappings:
            words += ["-r", f"{text(source, context)}:={text(target, context)}"]
        return words


@dataclass
class LaunchDescription:
    entities: list[Any]

    @property
    def arguments(self) -> list[DeclareLaunchArgument]:
        return [one for one in self.entities if isinstance(one, DeclareLaunchArgument)]

    def started(self, **given: str) -> list[tuple[Node, list[str]]]:
        """The nodes that would start, each with its arguments."""
        unknown = set(given) - {one.name for one in self.arguments}
        assert not unknown, f"no such argument: {unknown}"
        context: Context = {}
        for one in self.arguments:
            context[one.name] = given.get(one.name) or text(one.default_value, context)
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
    "launch.substitutions": [EqualsSubstitution, LaunchConfiguration, PathJoinSubstitution],
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
