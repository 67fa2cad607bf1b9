"""Commands as ros2_control's controllers take them, brought to rest when commands stop."""

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import SCENE, TRAINED, graph
from pa_ros.ros import topics
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


def test_velocities_follow_the_commands_and_end_with_commands_or_agent():
    ramp = {"agent_node__controller": "velocity", "agent_node__max_acceleration": 5.0}
    with graph(SimNode, AgentNode, **SCENE, **TRAINED, **ramp) as probe:
        assert probe.until(lambda: probe.count(topics.VELOCITY_COMMANDS) > 10)
        speeds = np.array(probe.last(topics.ARENA_INFO).speed_limits)
        seen = np.array([m.data for m in probe.heard["velocity_commands"]])
        assert seen.shape[1] == len(speeds) and (np.abs(seen) <= speeds + 1e-9).all()
        assert np.abs(np.diff(seen, axis=0)).max() <= 5.0 * 0.1 + 1e-9
        assert seen.any()
        assert probe.pause().success
        assert probe.until(lambda: not any(probe.last(topics.VELOCITY_COMMANDS).data))
        ended = probe.count(topics.VELOCITY_COMMANDS)
        probe.until(lambda: False, 0.5)
        assert probe.count(topics.VELOCITY_COMMANDS) == ended
        assert probe.pause(False).success
        moving = lambda: any(probe.last(topics.VELOCITY_COMMANDS).data)  # noqa: E731
        assert probe.until(moving)
        probe.nodes[-1].close()
        assert probe.until(lambda: not moving())


def test_a_joint_trajectory_has_one_point_one_control_period_ahead():
    with graph(
        SimNode, AgentNode, **SCENE, **TRAINED, agent_node__controller="joint_trajectory"
    ) as probe:
        assert probe.until(lambda: probe.count(topics.JOINT_TRAJECTORY) > 5)
        arena, (sent,) = probe.last(topics.ARENA_INFO), probe.heard["joint_trajectory"][3:4]
        assert list(sent.joint_names) == list(arena.joint_names)
        (point,) = sent.points
        assert (point.time_from_start.sec, point.time_from_start.nanosec) == (0, 100_000_000)
        starts = np.array([m.position for m in probe.heard["joint_states"]])
        ahead = np.array(point.positions) - 0.1 * np.array(point.velocities)
        assert np.abs(starts - ahead).max(axis=1).min() < 1e-6


def test_a_joint_jog_names_the_joints_and_says_for_how_long_it_holds():
    with graph(SimNode, AgentNode, **SCENE, **TRAINED, agent_node__controller="joint_jog") as probe:
        assert probe.until(lambda: probe.count(topics.JOINT_JOG) > 5)
        arena, sent = probe.last(topics.ARENA_INFO), probe.heard["joint_jog"][3]
        assert list(sent.joint_names) == list(arena.joint_names)
        assert sent.duration == pytest.approx(0.1) and not len(sent.displacements)
        assert np.any(sent.velocities)
        assert (np.abs(sent.velocities) <= np.array(arena.speed_limits) + 1e-9).all()
