"""What the packages rely on in others: hashes of standard types, and private attributes by name."""

import json
import os
import sys
import tomllib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from rclpy.lifecycle.node import LifecycleNodeMixin
from rclpy.node import Node
from rclpy.time_source import TimeSource

from helpers.sources import ROOT
from pa_ros.ros.lifecycle import LIFECYCLE_SERVICES

# Computed by rosidl's own generator from the definitions of ros2/geometry2 0.36.4, vision_msgs
# 4.1.1, control_msgs 5.8.0 and simulation_interfaces 1.5.1: the first 32 digits after "RIHS01_".
# The hash of a type covers the types of its fields, so nested messages need no line.
PUBLISHED = {
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa043",
    "vision_msgs/msg/Detection3DArray": "793f5eab9595ac1c0da07873cc859db4",
    "control_msgs/msg/JointJog": "ba249455a20f70168a1acb7bf43b776b",
    "control_msgs/action/GripperCommand": "e17c0e644eccf14bea84a0a93e097718",
    "simulation_interfaces/action/SimulateSteps": "f0837c898e1219cd73bf4c041feab41e",
    "simulation_interfaces/srv/DeleteEntity": "ff7e96a5b83dc8e2bb34b8b034480028",
    "simulation_interfaces/srv/GetEntities": "cb90004c48cd50f37732fb008e22c34c",
    "simulation_interfaces/srv/GetEntitiesStates": "0a76170d0c1c90e1eaf805cfab78ea80",
    "simulation_interfaces/srv/GetEntityInfo": "953b7ab6bfc35063f5c9a72463c6ce48",
    "simulation_interfaces/srv/GetEntityState": "749c91f2a2353d98367b64f2995a0f58",
    "simulation_interfaces/srv/GetSimulationState": "3362dcebee4b1afebbf9c4beee5c79c1",
    "simulation_interfaces/srv/GetSimulatorFeatures": "abb9439c8cf196722a469fb6c68b44b4",
    "simulation_interfaces/srv/GetSpawnables": "3bc0266bf8236058ff589c44512e013a",
    "simulation_interfaces/srv/ResetSimulation": "4ce285d7ff9b8ac70dcc95161f32bf54",
    "simulation_interfaces/srv/SetEntityState": "ca210e7d2b66629ae133c8e1edf5246e",
    "simulation_interfaces/srv/SetSimulationState": "a868b916dce49974f637ba252141258c",
    "simulation_interfaces/srv/SpawnEntity": "d4c086345d4194a5fc4c9ae45095736c",
    "simulation_interfaces/srv/StepSimulation": "913fe0653690ce6bf8f09f316e6a6267",
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_type_has_the_standards_hash(name):
    prefixes = [*filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(":")), sys.prefix]
    files = (Path(prefix) / "share" / f"{name}.json" for prefix in prefixes)
    described = json.loads(next(file for file in files if file.exists()).read_text())
    hashes = {one["type_name"]: one["hash_string"] for one in described["type_hashes"]}
    assert hashes[name].startswith(f"RIHS01_{PUBLISHED[name]}")


def test_constants_and_defaults_are_the_standards():
    standard = import_module("simulation_interfaces.srv")
    messages = import_module("simulation_interfaces.msg")
    assert standard.StepSimulation.Request().steps == 1
    assert standard.SpawnEntity.Response.INVALID_POSE == 109
    assert standard.SetSimulationState.Response.INCORRECT_TRANSITION == 103
    assert messages.SimulatorFeatures.STEP_SIMULATION_ACTION == 33
    assert messages.EntityCategory.CATEGORY_STATIC_OBJECT == 5


BOUNDED = ("ros-jazzy-rclpy", "viser")


def mentioned_in(function: Callable[..., object]) -> tuple[str, ...]:
    """Names of attributes that a function's code mentions."""
    return function.__code__.co_names


def test_rclpy_has_the_private_attributes_of_a_managed_node():
    for path in ("change_state", *LIFECYCLE_SERVICES):
        assert hasattr(LifecycleNodeMixin, f"_LifecycleNodeMixin__on_{path}")
    assert "_state_machine" in mentioned_in(LifecycleNodeMixin.__init__)
    assert "_time_source" in mentioned_in(Node.__init__)
    assert hasattr(TimeSource, "clock_callback")


def test_viser_has_the_private_attributes_by_which_a_page_is_known():
    viser = pytest.importorskip("viser", reason="the extra `console` is not installed")
    from viser.infra import WebsockServer

    assert "_websock_server" in mentioned_in(viser.ViserServer.__init__)
    assert "_live_connections" in mentioned_in(WebsockServer.__init__)


def test_their_versions_are_bounded():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    named = [*project["dependencies"], *sum(project["optional-dependencies"].values(), [])]
    bounds = [one for one in map(Requirement, named) if one.name in BOUNDED]
    assert {one.name for one in bounds} == set(BOUNDED)
    for one in bounds:
        assert any(bound.operator == "<" for bound in one.specifier), one
