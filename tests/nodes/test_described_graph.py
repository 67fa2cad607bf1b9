"""What `ros2 param describe` asks of the running nodes."""

from __future__ import annotations

from typing import Any

import pytest
from rcl_interfaces.srv import DescribeParameters

from agent_node.node import AgentNode
from helpers.graph import Probe, graph
from learner_node.node import LearnerNode
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


def described(probe: Probe, node: str, parameter: str) -> Any:
    """The descriptor that the node's service answers with."""
    client = probe.create_client(DescribeParameters, f"/{node}/describe_parameters")
    assert probe.until(client.service_is_ready)
    future = client.call_async(DescribeParameters.Request(names=[parameter]))
    assert probe.until(future.done), f"{node}: no answer"
    (descriptor,) = future.result().descriptors
    return descriptor


def test_running_nodes_describe_their_parameters() -> None:
    with graph(SimNode, AgentNode, LearnerNode, sim_node__paused=True) as probe:
        sim = described(probe, "sim_node", "real_time_factor")
        (range_,) = sim.floating_point_range
        assert sim.description == "simulation time per wall time, in real time"
        assert (range_.from_value, range_.to_value, sim.read_only) == (0.01, 100.0, True)

        agent = described(probe, "agent_node", "resend_period_s")
        (range_,) = agent.floating_point_range
        assert agent.description == "wall time; trajectories not yet taken up are sent again"
        assert agent.additional_constraints == "a number in (0, 1e+06]"
        assert (range_.from_value, agent.read_only) == (0.0, True)
        assert range_.to_value == 1e6

        learner = described(probe, "learner_node", "checkpoint_every_frames")
        (bounds,) = learner.integer_range
        assert learner.description == "0: only when the node stops"
        assert (bounds.from_value, bounds.to_value, bounds.step) == (0, 2**63 - 1, 1)
        assert learner.read_only
