"""An agent reports that it acts only while it does, and otherwise why it can't."""

from typing import Any

import pytest

from agent_node.node import AgentNode
from helpers.graph import SCENE, TRAINED, graph
from pa_ros.ros import topics
from pa_ros.ros.health import OK, WARN
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


def test_an_agent_that_rejects_every_step_says_why_until_steps_are_valid() -> None:
    """Features first lack a joint, and later contain all of them."""
    given = {**SCENE, "agent_node__weights": "random"}
    with graph(SimNode, AgentNode, remaps=["sim_node:object_features:=whole"], **given) as probe:
        out, joints = topics.OBJECT_FEATURES.publisher(probe), 5

        def pass_on(message: Any) -> None:
            message.joint_position = message.joint_position[:joints]
            out.publish(message)

        topic = topics.OBJECT_FEATURES
        probe.create_subscription(topic.type, "whole", pass_on, topic.reader)
        said = "takes in no step: object_features.joint_position: expected"
        assert probe.until(lambda: probe.message("agent_node").startswith(said))
        assert probe.health["/agent_node"].level == WARN and not probe.count(topics.JOINT_COMMANDS)
        joints = 6
        assert probe.until(lambda: probe.message("agent_node") == "acting")
        assert probe.health["/agent_node"].level == OK and probe.count(topics.JOINT_COMMANDS)


def test_an_agent_with_weights_for_another_arm_says_so() -> None:
    panda = {**SCENE, "sim_node__arm": "panda"}
    with graph(SimNode, AgentNode, **panda, **TRAINED) as probe:
        assert probe.until(lambda: "takes in no step: " in probe.message("agent_node"))
        assert probe.health["/agent_node"].level == WARN
        assert "expected" in probe.message("agent_node") and not probe.count(topics.JOINT_COMMANDS)
