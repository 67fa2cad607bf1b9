"""Private attributes of rclpy and viser that the packages use, each by name."""

import tomllib
from collections.abc import Callable

import pytest
from packaging.requirements import Requirement
from rclpy.lifecycle.node import LifecycleNodeMixin
from rclpy.node import Node
from rclpy.time_source import TimeSource

from helpers.sources import ROOT
from pa_ros.ros.lifecycle import LIFECYCLE_SERVICES

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
