"""A frozen configuration from ROS parameters, which then cannot change."""

from typing import Literal

import pytest
import rclpy
from pydantic import Field
from rclpy.parameter import Parameter

from agent_node.config import AgentConfig
from learner_node.config import LearnerNodeConfig
from pa_ros.core.errors import ConfigError
from pa_ros.core.settings import Settings
from pa_ros.ros.environment import prepare_environment
from pa_ros.ros.parameters import NodeParameters
from sim_node.config import SimConfig

pytestmark = pytest.mark.graph


class Part(Settings):
    share: float = Field(0.25, ge=0, lt=1, description="of the whole")


class Config(Settings):
    number: int = Field(1, ge=1, description="how many")
    factor: float = 0.5
    name: str = "x"
    flag: bool = False
    words: tuple[str, ...] = ()
    kind: Literal["small", "large"] = "small"
    part: Part = Part()


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
    assert NodeParameters(node, Config).fix() == Config()
    assert node.get_parameter("factor").value == 0.5


def test_overrides_arrive_in_the_fields_types(node_with):
    node = node_with(
        "number:=7", "factor:=2", "name:='3'", "flag:=true", "words:=[a, 'b=1']", "part.share:=0.5"
    )
    config = NodeParameters(node, Config).fix()
    assert config == Config(
        number=7, factor=2.0, name="3", flag=True, words=("a", "b=1"), part=Part(share=0.5)
    )
    assert isinstance(config.factor, float)


@pytest.mark.parametrize(
    ("parameter", "shown"),
    [("number:=1.5", "1.5"), ("number:=true", "True"), ("name:=3", "3"),
     ("nmae:=x", "did you mean 'name'"),
     ("words:=x", "'x'"), ("number:=0", "at least 1, got 0"),
     ("part.share:=1.0", "part.share: .*got 1.0"), ("use_sim_timee:=true", "use_sim_timee"),
     ("use_sim_time_factor:=2", "use_sim_time_factor"), ("qos_overridess:=1", "qos_overridess"),
     ("start_type_description_services:=false", "start_type_description_services"),
     ("use_sim_time:=1", "use_sim_time: expected true or false, got 1"),
     ("use_sim_time:=yess", "use_sim_time: expected true or false, got 'yess'")],
)  # fmt: skip
def test_wrong_types_and_unknown_names_are_refused(node_with, parameter, shown):
    node = node_with(parameter)
    with pytest.raises(ConfigError, match=shown):
        parameters = NodeParameters(node, Config)
        parameters.open()  # as when an unconfigured node is shut down
        parameters.fix()


def test_later_changes_are_rejected_with_a_reason(node_with):
    node = node_with()
    NodeParameters(node, Config).fix()
    result = node.set_parameters([Parameter("number", value=2)])[0]
    assert not result.successful and "number" in result.reason
    assert node.get_parameter("number").value == 1


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [("number", 0, "number: expected an integer of at least 1, got 0"),
     ("flag", "yes", "flag: expected true or false, got 'yes'"),
     ("kind", "smal",
      "kind: expected one of ['small', 'large'], got 'smal'; did you mean 'small'?"),
     ("part.share", float("nan"), "part.share: expected a number in [0, 1), got nan")],
)  # fmt: skip
def test_an_impossible_value_is_rejected_when_it_is_set(node_with, name, value, said):
    node = node_with("number:=3")
    parameters = NodeParameters(node, Config)
    for again in range(2):  # before the first configuring, and after a cleanup
        both = [Parameter(name, value=value), Parameter("factor", value=2)]
        rejected, accepted = node.set_parameters(both)
        assert not rejected.successful and rejected.reason == said and accepted.successful
        if not again:
            parameters.fix()
            parameters.open()
    assert parameters.fix() == Config(number=3, factor=2.0)


def test_parameters_are_described_with_what_they_expect(node_with):
    node = node_with("part.share:=0")
    NodeParameters(node, Config).fix()
    number, share = (node.describe_parameter(name) for name in ("number", "part.share"))
    assert (number.description, number.read_only) == ("how many", True)
    assert share.additional_constraints == "a number in [0, 1)" and share.read_only
    assert node.get_parameter("part.share").value == 0.0


@pytest.mark.parametrize(
    ("kind", "name", "constraint"),
    [
        (SimConfig, "mode", "one of ['lockstep', 'real_time']"),
        (AgentConfig, "stuck_after_s", "a number in (0, 1e+06]"),
        (LearnerNodeConfig, "checkpoint_every_frames", "an integer of at least 0"),
    ],
)
def test_each_nodes_parameters_say_what_they_mean(node_with, kind, name, constraint):
    node = node_with()
    NodeParameters(node, kind).fix()
    described = node.describe_parameter(name)
    assert (described.additional_constraints, described.read_only) == (constraint, True)
    assert described.description


def test_a_parameter_that_nobody_gave_follows_the_recipe(node_with):
    node = node_with("recipe:=paper", "learner.replay.batch_size:=8")
    parameters = NodeParameters(node, LearnerNodeConfig)
    assert node.get_parameter("learner.updates.discount").value is None
    settings = parameters.fix()
    assert settings.learner.updates.discount == 0.99
    assert node.get_parameter("learner.updates.discount").value == 0.99
    assert node.get_parameter("network.family").value == "programmable"
    parameters.open()
    node.set_parameters([Parameter("recipe", value="ours")])
    settings = parameters.fix()
    assert settings.learner.updates.discount == 0.95
    assert settings.learner.replay.batch_size == 8


def test_the_recipes_older_name_is_accepted(node_with):
    parameters = NodeParameters(node_with("protocol:=paper"), LearnerNodeConfig)
    assert parameters.fix().recipe == "paper"
    assert parameters.fix_again(recipe="push").recipe == "paper"


@pytest.mark.parametrize("name", ["recipe", "protocol"])
def test_an_unknown_recipe_is_refused(node_with, name):
    with pytest.raises(ConfigError, match="recipe: expected one of .*, got 'papr'"):
        NodeParameters(node_with(f"{name}:=papr"), LearnerNodeConfig).fix()


def test_an_algorithms_own_settings_are_parameters(node_with):
    node = node_with("algorithm:=td3", "learner.targets.tau:=0.1")
    settings = NodeParameters(node, LearnerNodeConfig).fix()
    assert settings.flat()["learner.targets.tau"] == 0.1
    assert node.get_parameter("learner.delay").value == 2
    assert not node.has_parameter("learner.gradient_clip")
