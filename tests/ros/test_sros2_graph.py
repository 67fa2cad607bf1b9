"""The SROS2 policies say what nodes say and hear, and no more. (That they hold is untested.)"""

from pathlib import Path
from xml.etree import ElementTree

import pytest

import pa_ros.ros
from agent_node.node import AgentNode
from helpers.graph import graph
from learner_node.node import LearnerNode
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
POLICIES = Path(pa_ros.ros.__file__).with_name("sros2") / "policies.xml"
OF_RCLPY = {"describe_parameters", "get_parameter_types", "get_parameters", "list_parameters",
            "set_parameters", "set_parameters_atomically", "get_type_description"}  # fmt: skip

# Of arenas with a camera, and of agents that execute goals, send commands to controllers, or are
# looked at by a viewer.
AT_TIMES = {
    "sim_node": {"publish": {"/camera/image_raw", "/camera/camera_info"}, "subscribe": set()},
    "agent_node": {
        "publish": {"/program", "/velocity_commands", "/joint_trajectory", "/joint_jog"},
        "subscribe": {"/program_status", "/markers"},
    },
}


def allowed(node: str, kind: str, right: str) -> set[str]:
    tree = ElementTree.parse(POLICIES)
    path = f".//profile[@node='{node}']/{kind}s[@{right}='ALLOW']/{kind}"
    names = [element.text or "" for element in tree.findall(path)]
    names = [name.replace("~", node) for name in names]
    return {name if name.startswith("/") else f"/{name}" for name in names}


def test_sros2_policies_allow_exactly_what_nodes_use() -> None:
    with graph(SimNode, AgentNode, LearnerNode, agent_node__learning=True) as probe:
        for node in probe.nodes:
            name = node.get_name()
            said = {p.topic_name for p in node.publishers}
            heard = {s.topic_name for s in node.subscriptions}
            more = AT_TIMES.get(name, {"publish": set(), "subscribe": set()})
            said |= more["publish"] | {"/rosout", f"/{name}/transition_event"}  # which rcl makes
            assert allowed(name, "topic", "publish") == said
            assert allowed(name, "topic", "subscribe") == heard | more["subscribe"]
            own = {f"/{name}/{service}" for service in OF_RCLPY}
            served = {node.resolve_service_name(s.service_name) for s in node.services} - own
            assert allowed(name, "service", "reply") == served
