"""A frozen configuration from ROS parameters, which then cannot change."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
import rclpy
from rclpy.parameter import Parameter

from pa_ros.core.errors import ConfigError
from pa_ros.ros.environment import prepare_environment
from pa_ros.ros.parameters import config_from_parameters

pytestmark = pytest.mark.graph


@dataclass(frozen=True)
class Config:
    number: int = 1
    factor: float = 0.5
    name: str = "x"
    flag: bool = False
    words: tuple[str, ...] = ()


@pytest.fixture
def node_with():
    prepare_environment()
    nodes = []

    def make(*parameters: str):
        arguments = ["--ros-args"]
        for parameter in parameters:
            arguments += ["-p", parameter]
        rclpy.init(args=arguments)
        node = rclpy.create_node("n", automatically_declare_parameters_from_overrides=True)
        nodes.append(node)
        return node

    yield make
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown()


def test_defaults_are_declared_so_that_tools_can_list_them(node_with):
    node = node_with()
    assert config_from_parameters(node, Config) == Config()
    assert node.get_parameter("factor").value == 0.5


def test_overrides_arrive_in_the_fields_types(node_with):
    node = node_with("number:=7", "factor:=2", "name:='3'", "flag:=true", "words:=[a, 'b=1']")
    config = config_from_parameters(node, Config)
    assert config == Config(7, 2.0, "3", True, ("a", "b=1"))
    assert isinstance(config.factor, float)


@pytest.mark.parametrize(
    ("parameter", "shown"),
    [("number:=1.5", "1.5"), ("number:=true", "True"), ("name:=3", "3"), ("nmae:=x", "nmae"),
     ("words:=x", "'x'")],
)  # fmt: skip
def test_wrong_types_and_unknown_names_are_refused(node_with, parameter, shown):
    with pytest.raises(ConfigError, match=shown):
        config_from_parameters(node_with(parameter), Config)


def test_later_changes_are_rejected_with_a_reason(node_with):
    node = node_with()
    config_from_parameters(node, Config)
    result = node.set_parameters([Parameter("number", value=2)])[0]
    assert not result.successful and "number" in result.reason
    assert node.get_parameter("number").value == 1
