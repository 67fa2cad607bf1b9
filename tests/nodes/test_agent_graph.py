"""What an agent says, does and sends on the graph, and why it doesn't act."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers import learners
from helpers.graph import SCENE, TRAINED, graph
from helpers.learners import LEARNER, WORLD, published
from pa_ros.ros import topics
from pa_ros.ros.health import ERROR, OK, WARN
from pa_ros.wire.learning import decode_trajectory, encode_learner_info, encode_weights
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


def test_a_learning_agent_waits_for_weights_beyond_the_policy_lag() -> None:
    """The update-to-data ratio from the agent's side: without new weights no new experience."""
    times = {"agent_node__stuck_after_s": 1.0, "agent_node__resend_period_s": 0.5}
    with graph(SimNode, AgentNode, agent_node__learning=True, **times) as probe:
        speaker = probe.speaker(topics.POLICY_WEIGHTS)
        speaker.publish(encode_weights(published(0)))
        probe.speaker(topics.LEARNER_INFO).publish(encode_learner_info(LEARNER))
        assert probe.until(lambda: "stuck at 0" in probe.message("agent_node"))
        # They are sent again: perhaps nobody received them.
        assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > 2)
        trajectories = [decode_trajectory(m, WORLD) for m in probe.heard["trajectories"]]
        assert {s.sequence for s in trajectories} == {0, 1}  # lag 1: one more than the weights
        assert all(s.policy_version == 0 and len(s) == 10 for s in trajectories)
        assert "trajectories before 1" in probe.message("agent_node")
        _, node = probe.nodes
        speaker.publish(encode_weights(replace(published(1), accounted={node.agent.key: 1})))
        assert probe.until(lambda: probe.value("agent_node", "policy_version") == "1")
        # It acts again, for one trajectory: too short a time to rely on its message.
        sent = lambda: decode_trajectory(probe.last(topics.TRAJECTORIES), WORLD)  # noqa: E731
        assert probe.until(lambda: sent().policy_version == 1)


def test_an_agent_that_cannot_comply_with_the_learner_does_not_act() -> None:
    with graph(SimNode, AgentNode, agent_node__learning=True) as probe:
        speaker = probe.speaker(topics.LEARNER_INFO)
        other_edition = encode_learner_info(LEARNER)
        other_edition.wire_version = "1"
        speaker.publish(other_edition)
        assert probe.until(lambda: probe.value("agent_node", "refused.wire.version") == "1")
        speaker.publish(encode_learner_info(replace(LEARNER, thresholds=(0.1,))))
        weights = probe.speaker(topics.POLICY_WEIGHTS)
        weights.publish(encode_weights(published(0)))
        reason = "does not act for the learner: learner_info.thresholds: expected (0.2,)"
        assert probe.until(lambda: probe.message("agent_node").startswith(reason))
        assert probe.health["/agent_node"].level == ERROR
        assert probe.value("agent_node", "refused.learner.request") == "1"
        assert probe.count(topics.JOINT_COMMANDS) == 0
        another = replace(LEARNER, learner_id="another", stamp_ns=2)  # one that it can serve
        speaker.publish(encode_learner_info(another))
        weights.publish(encode_weights(replace(learners.published(0), learner_id="another")))
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > 10)
        assert probe.until(lambda: not probe.message("agent_node").startswith("does not act"))


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
